"""The contract between firmware and hardware: `rrins.dbc`, and the codec built from it.

The only code that both sides share. Nothing outside this package knows a bit position.
"""

from dbc.compilation import keep_compiled_code

keep_compiled_code()
