"""What a navigation computer on this bus owes, checked on any program: `rrins conform`."""
