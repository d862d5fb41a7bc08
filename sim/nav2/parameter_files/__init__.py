"""Nav2 parameter files: one table of modeled nodes and classes reads, checks, rewrites, and writes them."""
