"""Judgement: what an oracle is, how a run is judged, what a verdict holds, and why a run failed."""
