"""Factor graphs: variables, factors, and their text files."""
