"""Reading and checking: from users' files and values to the inputs of runs."""
