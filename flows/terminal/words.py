"""Words that sentences for people are made of."""


def count_text(n: int, noun: str, plural: str = "") -> str:
    """Such as `1 run`, `1,816 runs` and `2 families`."""
    return f"{n:,} {noun if n == 1 else plural or f'{noun}s'}"
