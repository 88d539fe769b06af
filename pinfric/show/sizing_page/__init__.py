"""The sizing page: one self-contained HTML file."""
