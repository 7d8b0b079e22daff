"""What this bus demands of a navigation computer, checked on any program: `rrins conform`."""
