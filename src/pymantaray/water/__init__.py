"""What sound runs through, from any source: fields, medium, currents, and what receivers listen for."""
