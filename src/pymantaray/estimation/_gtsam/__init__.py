"""Everything that touches GTSAM; nothing outside this folder imports it."""
