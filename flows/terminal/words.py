"""Counts in sentences."""


def count_text(n: int, noun: str, plural: str = "") -> str:
    """Return a count such as `1 run`, `1,816 runs`, or `2 families`."""
    return f"{n:,} {noun if n == 1 else plural or f'{noun}s'}"
