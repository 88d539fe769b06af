"""What users ask: trajectories, summaries, sizing."""
