"""Everything around the firmware: the emulated hardware, the bus, the rehearsal and its tools."""
