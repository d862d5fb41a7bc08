"""Publication: a campaign directory as one archive, and its verification elsewhere."""
