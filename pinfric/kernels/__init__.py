"""How kernels are compiled, kept and, on few numbers, interpreted."""
