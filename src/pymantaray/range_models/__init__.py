"""Range models along eigenrays in an assumed ocean, which several applications use."""
