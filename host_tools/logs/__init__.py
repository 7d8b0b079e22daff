"""Logs of the bus: recorded, replayed (onto a bus or through the firmware), exported, drawn."""
