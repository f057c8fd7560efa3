"""Pages of results as HTML: layout, interactive plots, files."""
