"""What a campaign directory holds, read back: its tables, its scenarios, its runs, and the factors that vary in them."""
