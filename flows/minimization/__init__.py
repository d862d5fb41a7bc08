"""Minimization: the failing configuration, the runs of its candidates, and the campaign file of the result."""
