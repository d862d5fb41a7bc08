"""Nav2 parameter files: the table of modeled nodes and classes, by which files are read, checked, rewritten, and written."""
