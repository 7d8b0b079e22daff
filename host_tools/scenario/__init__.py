"""Scenarios: every key a TOML file can set, the built-in scenarios, and the sensor presets."""
