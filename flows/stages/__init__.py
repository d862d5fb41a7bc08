"""The Python API, stage by stage."""
