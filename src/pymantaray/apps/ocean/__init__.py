"""Commands that check, show, plot and make oceans."""
