"""All code that uses GTSAM; no other folder imports it."""
