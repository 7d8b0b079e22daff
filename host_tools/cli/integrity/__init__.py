"""Commands for the trust in a unit under faults."""
