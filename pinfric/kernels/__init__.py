"""Compiling, caching and, for small problems, interpreting of kernels."""
