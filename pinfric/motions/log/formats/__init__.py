"""Formats of logs: a function each, found by the ends of files' names (`registry`)."""
