"""The terminal screen of `rrins monitor`; the only part that imports textual."""
