"""How wrong is it: trajectory errors and range-error statistics. Truth and estimate meet only here."""
