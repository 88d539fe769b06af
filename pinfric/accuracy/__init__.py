"""Computing time against accuracy: studies of methods."""
