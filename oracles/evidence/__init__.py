"""Evidence from verdicts: rates, causes, findings, and the paired runs of two campaigns."""
