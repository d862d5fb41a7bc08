"""One run of a campaign: preparation, computation, and report."""
