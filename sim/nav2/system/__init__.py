"""The navigation stack as a system: what it tells of itself, its files, and its keys."""
