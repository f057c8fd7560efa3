"""Limit for unpacking: a small compressed file can contain more data than the memory."""

MAX_UNPACKED_BYTES = 2_000_000_000
"""
Maximum size of data unpacked into memory at a time: a table, or a chunk of an array or of a bag.
"""
