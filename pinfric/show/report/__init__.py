"""Results as tables for people and dictionaries for programs."""
