"""Queries: selections of runs, what they come to, the frames of one run, and what a map shows of many."""
