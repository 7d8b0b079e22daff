"""Serial lines on the host: options of the firmware's lines."""
