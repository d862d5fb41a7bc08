"""Statistics over counts of passes: how sure, which kind, what matters, where, how many runs, what has changed."""
