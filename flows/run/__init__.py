"""One run of a campaign: what it opens and computes, and the report that follows."""
