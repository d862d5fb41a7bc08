"""Scenarios as behaviour trees, ticked in simulated time."""
