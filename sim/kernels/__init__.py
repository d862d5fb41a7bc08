"""How kernels are compiled, and the arithmetic that many of them share."""
