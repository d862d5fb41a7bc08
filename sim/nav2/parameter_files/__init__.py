"""Nav2 parameter files: read, interpreted, rewritten, and written."""
