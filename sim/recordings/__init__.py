"""Recordings: what happened in runs, and the files it is kept in."""
