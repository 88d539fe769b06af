"""Motors, gears, bearings and brakes: catalogues, conditions, limits, and what a cycle demands."""
