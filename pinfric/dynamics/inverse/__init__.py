"""The efforts that a given motion takes: trees, linkages, ends of intervals, superposition."""
