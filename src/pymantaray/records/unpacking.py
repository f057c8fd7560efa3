"""How much compressed files may unpack to: a small file can hold more than the machine's memory or disk."""

MAX_UNPACKED_BYTES = 2_000_000_000
"""Of what is unpacked into memory at a time: a table, a chunk of an array or of a bag."""
