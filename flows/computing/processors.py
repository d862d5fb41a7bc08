"""Processors of this machine that may be used."""

import os


def cores() -> int:
    """Processors this process may use: worker processes where nobody says how many."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
