"""`rrins dashboard`: a rehearsal or a recording in a browser: table, plots, map, bus, controls."""
