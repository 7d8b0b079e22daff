"""Ways for other tools to the bus: socketcand and slcan servers."""
