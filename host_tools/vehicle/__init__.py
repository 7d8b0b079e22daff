"""Recordings of real vehicles as bus recordings, and increments for other navigators."""
