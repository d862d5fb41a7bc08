"""The plan: what a run would do and why, before anything of it is run."""
