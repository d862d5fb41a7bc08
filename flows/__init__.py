"""Prefect flows, the Python API and the command line."""
