"""The plan: the work of a run and its reasons, before it runs."""
