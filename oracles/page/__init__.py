"""The page of a report: its words, rows, and pictures."""
