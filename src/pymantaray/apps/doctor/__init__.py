"""Report of packages, extras, folders, processors and faults of an installation."""
