"""What redundant sensors are for: to find the one that fails, leave it out, and lose nothing."""
