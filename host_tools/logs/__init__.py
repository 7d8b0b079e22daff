"""Bus logs: replay (onto a bus or through the firmware), comparison, export and plots."""
