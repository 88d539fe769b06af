"""The fastest motion that real drives can do along a path."""
