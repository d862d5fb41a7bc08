"""Queries: selections of runs, their statistics, the frames of one run, and scenes of many runs on a map."""
