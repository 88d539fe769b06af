"""What the studies of accuracy look like: table and picture."""
