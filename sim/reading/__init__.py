"""Reading and checking: from the files and values that people write to what a run is computed from."""
