"""Tasks with keys: storage of results, folders, worker pools and progress."""
