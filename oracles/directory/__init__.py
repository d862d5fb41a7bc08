"""What a campaign directory holds, read back: its tables, its scenarios, the paths that were driven."""
