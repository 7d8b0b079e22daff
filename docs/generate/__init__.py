"""Writers of the documentation pages that are made from code; run from `docs/` by `make docs`."""
