"""Results in words and figures: tables for people, dictionaries for programs."""
