"""The engine: finds in the store what a campaign has, and computes what is missing in a pool of worker processes."""
