"""Values that every layer shares: poses, obstacles, scenarios, recordings, faults, names, and digests."""
