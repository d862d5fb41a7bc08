"""Notebooks as oracles, and the tables that they are given."""
