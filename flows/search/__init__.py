"""Searches: batches, evaluations, and tables."""
