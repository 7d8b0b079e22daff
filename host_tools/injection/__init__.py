"""Live faults: injected into a running rehearsal, listed and removed by any client on the bus."""
