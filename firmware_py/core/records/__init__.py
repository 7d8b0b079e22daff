"""The firmware's memory: the records of the RAM image, and the list of trouble codes."""
