"""Instantiation: families of configurations, read, grown through their producers, and counted."""
