"""Campaign directories: the schema of their tables, scenarios, runs, and factors."""
