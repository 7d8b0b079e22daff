"""The version of the project, which its firmware shows."""

VERSION = "0.1.0"
"""By semantic versioning: `docs/stability.md`."""
