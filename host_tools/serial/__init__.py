"""Serial lines seen from the host: options of the firmware's lines, and slcan adapters."""
