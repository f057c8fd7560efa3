"""Tasks with keys: their store, their folders, the processes that do them, and how far they are."""
