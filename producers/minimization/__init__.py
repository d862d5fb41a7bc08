"""Minimization: reduce a failing scenario to a smallest one that still fails."""
