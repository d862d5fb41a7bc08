"""Designs: covering arrays and samples of a family's choices."""
