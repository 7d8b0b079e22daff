"""`rrins monitor`: what is on the bus now, as a terminal screen, a table or JSON.

Frames flow one way: `receiver` (a thread on the bus) -> `watch` (last frames, counts, histories;
`tally` is its compiled part) -> `state` (what holds at one moment) -> `vitals`, `troubles`,
`listing`, `wording` -> `once` (a table, JSON) or `screen` (textual). Only `screen` imports textual.
"""
