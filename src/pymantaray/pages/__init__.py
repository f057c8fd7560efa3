"""Pages and figures: style, layout, files; a library that applications import."""
