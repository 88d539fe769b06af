"""Logs of real robots: read in many dialects, repaired and judged."""
