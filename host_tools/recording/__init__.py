"""Records a bus to a log file with an accompanying note; log formats."""
