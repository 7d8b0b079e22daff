"""Alignment and strapdown navigation."""
