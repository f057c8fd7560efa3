"""Range models along eigenrays of a believed ocean, which several applications use."""
