"""Postprocessing steps of a campaign file, each run in its own process over a copy of the results."""
