"""Frames in: what is taken from each message, its checks, groups, senders and clock."""
