"""Factor graphs from files: formats, minima, certificates."""
