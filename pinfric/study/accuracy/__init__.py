"""What accuracy costs in time: studies of method."""
