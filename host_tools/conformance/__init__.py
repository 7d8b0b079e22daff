"""The demands of this bus on a navigation computer, checked on any program: `rrins conform`."""
