"""The services, one file per group of ISO 14229-1."""
