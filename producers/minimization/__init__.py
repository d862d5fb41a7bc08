"""Minimization: a failing scenario becomes a smallest one that still fails, by what its runs come to."""
