"""Files that describe computer and bus to other tools: diagnosis as PDX, the contract's dialects.

`exchanges` says in the diagnostic table's own terms which requests and responses there are,
`dictionary`, `states` and `communication` describe them as ODX does, and `pdx` writes the file.
"""
