"""Exec: one scenario and one seed to one run's recording."""
