"""The engine: computes the missing artifacts of a campaign in a pool of worker processes."""
