"""Compilation of kernels, and arithmetic that many of them share."""
