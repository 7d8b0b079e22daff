"""The contract between firmware and hardware: `rrins.dbc`, and the codec built from it.

The only code that both sides share. Only this package knows bit positions.
"""
