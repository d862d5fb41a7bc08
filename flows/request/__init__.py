"""Requests: the campaign file, read and checked, its keys, and the selection to run."""
