"""Commands that attach to a bus: watch, show, record, and serve it to other tools."""
