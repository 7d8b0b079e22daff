"""`rrins monitor`: the current state of a bus, as a terminal screen, a table or JSON.

Frames flow one way: `receiver` (a thread on the bus) -> `watch` (last frames, counts, histories;
`tally` is its compiled part) -> `state` (a snapshot) -> `vitals`, `troubles`,
`listing`, `wording` -> `once` (a table, JSON) or `screen` (textual). Only `screen` imports textual.
`opening` and `orders` import nothing heavy: the command shows something before it loads the rest.
"""
