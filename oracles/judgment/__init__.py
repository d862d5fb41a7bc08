"""Judgment: oracles, verdicts, judging of runs, and causes of failures."""
