"""Counts in words."""


def counted(count: int, noun: str) -> str:
    """A count with its noun: `1 pose`, `2 poses`; for nouns whose plural ends in s."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
