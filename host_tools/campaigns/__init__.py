"""Campaigns: many runs of a scenario that differ, in threads, processes or on a Dask cluster."""
