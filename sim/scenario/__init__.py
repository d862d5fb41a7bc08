"""Scenarios: their language, their behavior trees, and the programs that they run."""
