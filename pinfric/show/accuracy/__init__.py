"""Tables and pictures of the studies of accuracy."""
