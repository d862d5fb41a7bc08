"""A campaign and its stages: preparation, task runs of Prefect, searches, postprocessing, and report."""
