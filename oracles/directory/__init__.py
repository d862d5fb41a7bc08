"""What a campaign directory holds, read back: its tables, its scenarios, the ways that were driven."""
