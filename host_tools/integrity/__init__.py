"""Trust in the navigation under faults, from whole runs: error against bound, and the FMEDA."""
