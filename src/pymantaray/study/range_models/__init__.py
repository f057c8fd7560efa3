"""Range models of a study that trace rays through what is believed of the ocean, and their uncertainty."""
