"""Files that describe computer and bus to other tools: diagnosis as PDX, the contract's dialects.

`dictionary`, `states` and `communication` describe `diag.exchanges` as ODX does, and `pdx` writes
the file.
"""
