"""Balanced Latin squares: orders in which each condition follows each other one equally often."""

import numpy as np


def balanced_square(count: int) -> np.ndarray:
    """Williams' design of `count` conditions, numbered from 0: int64, shape [row, position].

    `count` rows where it is even, else twice as many, as no single square is balanced then; one row for one condition.
    Each condition comes once in a row and equally often at each position, and each ordered pair of neighbours equally
    often. The first row is 0, 1, count - 1, 2, count - 2, ...; the others add 1, modulo `count`. Of an odd count, the
    second half of the rows are those of the first half, read backwards.
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, not {count}")
    first = np.array([(place + 1) // 2 if place % 2 else -(place // 2) for place in range(count)])
    square = (first + np.arange(count)[:, np.newaxis]) % count
    if count % 2 and count > 1:
        square = np.concatenate([square, square[:, ::-1]])
    return square


def row_count(count: int) -> int:
    """Rows of the balanced square of `count` conditions: so many participants fill it once."""
    return count if count % 2 == 0 or count == 1 else 2 * count


def square_fault(condition_count: int, participant_count: int) -> str | None:
    """Describe why participants do not fill whole balanced squares, and the nearest that do; None where they do."""
    rows = row_count(condition_count)
    if participant_count > 0 and participant_count % rows == 0:
        return None
    below = participant_count // rows * rows
    nearest = f"{below} or {below + rows}" if below else f"{rows}"
    sentence = (
        f"the order of blocks is not balanced: a balanced Latin square of {condition_count} blocks has {rows} rows, "
        f"and {participant_count} participants fill no whole ones; the nearest that do are {nearest} participants"
    )
    others = [
        count
        for count in (condition_count - 1, condition_count + 1)
        if count > 1 and participant_count > 0 and participant_count % row_count(count) == 0
    ]
    if others:
        sentence += f", or {participant_count} with {' or '.join(map(str, others))} blocks"
    return sentence
