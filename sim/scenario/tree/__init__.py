"""Scenarios as behavior trees, ticked in simulated time."""
