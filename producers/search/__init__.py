"""Search: which points of a space are looked at next, by what was found at those before."""
