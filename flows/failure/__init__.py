"""Failures as reports: a failed run with all that somebody else needs to repeat it."""
