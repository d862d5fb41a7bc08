"""Results beside those of the paper."""
