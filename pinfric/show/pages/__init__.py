"""Pages to read, print and sign, each one self-contained HTML file."""
