"""Live faults: put into a rehearsal under way, listed and taken out again by anyone on the bus."""
