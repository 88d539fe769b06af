"""How it moves: reactions, inverse and forward dynamics, simulation."""
