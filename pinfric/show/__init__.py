"""What they see: plots, tables, replay."""
