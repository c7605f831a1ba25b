"""Board files (`.pat`) as tests write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

GRID = [round(-78.75 + 10.5 * step, 2) for step in range(16)]


def board_lines(rng: np.random.Generator) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """A board file as OpenMPD writes it, with its pins, offsets [degrees] and factors, in the file's order."""
    pin, offset = rng.permutation(256), rng.integers(-180, 181, 256)
    factor = np.round(rng.random(256), 6)
    places = [f"({x / 1e3:.6f}, {y / 1e3:.6f}, 0.000000)" for x in GRID for y in GRID[::-1]]
    lists = [places, pin, offset, [f"{value:.6f}" for value in factor]]
    return ["FT4TKZL8", "256", "128", *(",".join(map(str, values)) + "," for values in lists)], pin, offset, factor


def write(path: Path, lines: list[str], ending: str = "\n") -> Path:
    path.write_bytes((ending.join(lines) + ending).encode())
    return path
