"""Pages to read, to print and to sign: one self-contained HTML file each, of one template."""
