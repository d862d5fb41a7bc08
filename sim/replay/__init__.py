"""Replays: a recorded run executed once more, and looked at."""
