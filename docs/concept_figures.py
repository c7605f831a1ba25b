"""Draws the figures of docs/concepts/ from what palpate computes: `python docs/concept_figures.py`.

A test compares the files with what this draws.
"""

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np

from palpate.render import MeshObject, Palm, render, static_pose

FOLDER = Path(__file__).parent / "concepts"
SIDE = 0.085  # of the palm [m]
POSE = (0.04, 0.0, 0.2)  # of the palm: over a tube, at its rim [m]
SCALE = 1600.0  # pixels a metre
PANEL, MARGIN, CAPTION = 190, 16, 40  # [pixel]
KINDS = {0: "#00796b", 1: "#e65100", 2: "#5e35b1"}  # on the object, on the palm's edge, made by a stage
INTERSECTIONS = {
    "oc": "oc: the object's skin on the palm",
    "cc": "cc: closed by the palm's edge",
    "hatch": "hatch: the overlap filled",
    "ellipse": "ellipse: an ellipse like it",
}
SAMPLINGS = {"stm": "stm: round, with jumps", "pendulum": "pendulum: there and back"}


def main() -> None:
    """Write the figures."""
    for name, text in figures().items():
        (FOLDER / name).write_text(text)


def figures() -> dict[str, str]:
    """The figures as SVG, by file name."""
    return {
        "intersection.svg": picture([_intersection(name) for name in INTERSECTIONS], INTERSECTIONS.values()),
        "sampling.svg": picture([_cycle(name) for name in SAMPLINGS], SAMPLINGS.values()),
        "pose-to-wire.svg": _way(),
    }


def picture(panels: list[str], captions: Iterable[str]) -> str:
    """Panels side by side, each over its caption."""
    parts = []
    for k, (panel, caption) in enumerate(zip(panels, captions, strict=True)):
        parts.append(f'<g transform="translate({MARGIN + k * (PANEL + MARGIN)} {MARGIN})">')
        parts.append(f'<svg width="{PANEL}" height="{PANEL}">{panel}</svg>')
        parts.append(f'<text x="{PANEL / 2:g}" y="{PANEL + 22}" text-anchor="middle">{caption}</text></g>')
    return _svg(len(panels) * (PANEL + MARGIN) + MARGIN, PANEL + MARGIN + CAPTION, "\n".join(parts))


def _svg(width: float, height: float, content: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" '
        f'viewBox="0 0 {width:g} {height:g}" font-family="sans-serif" font-size="12">\n'
        f'<rect width="100%" height="100%" fill="white"/>\n{content}\n</svg>\n'
    )


def _intersection(strategy: str) -> str:
    """The palm, the section of the whole plane in grey, and the contours by the kind of their segments."""
    whole = "".join(_line(points, "#bdbdbd", 1) for points in _contours("whole")[0])
    lines, kinds = _contours(strategy)
    drawn = "".join(
        _line(points[k : k + 2], KINDS[int(kind[k])], 3)
        for points, kind in zip(lines, kinds, strict=True)
        for k in range(len(points) - 1)
    )
    return _palm() + whole + drawn


def _contours(strategy: str) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Polylines of the one pose on the palm [m], from its middle, and the kind of each of their segments."""
    batch = render(MeshObject.load("tube"), Palm(SIDE, SIDE), static_pose(list(POSE)), strategy)
    starts = batch.polyline_start
    lines = [batch.points[a:b] for a, b in pairwise(starts)]
    kinds = [batch.kind[a : b - 1] for a, b in pairwise(starts)]
    return [line[:, [0, 1]] - np.array([POSE[0], POSE[1]]) for line in lines], kinds


def _cycle(sampling: str) -> str:
    """Every fifth focal point of one cycle, from pale to dark, joined in their order."""
    batch = render(MeshObject.load("tube"), Palm(SIDE, SIDE), static_pose(list(POSE)), "oc")
    points = batch.sample(sampling, duration=0.5)
    count = round(points.update_rate / points.draw_frequency)
    drawn = points.position[:count:5, [0, 1]] - np.array([POSE[0], POSE[1]])
    dots = [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="#00796b" fill-opacity="{0.2 + 0.8 * k / len(drawn):.2f}"/>'
        for k, (x, y) in enumerate(_pixels(drawn))
    ]
    return _palm() + _line(drawn, "#bdbdbd", 1) + "".join(dots)


def _palm() -> str:
    low, side = PANEL / 2 - SIDE / 2 * SCALE, SIDE * SCALE
    return f'<rect x="{low:g}" y="{low:g}" width="{side:g}" height="{side:g}" fill="#fbe9e7" stroke="#e0a899"/>'


def _pixels(points: np.ndarray) -> np.ndarray:
    return points * SCALE + PANEL / 2


def _line(points: np.ndarray, colour: str, width: float) -> str:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in _pixels(points))
    return f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}"/>'


STEPS = (
    ("a pose", "90 a second", "7 numbers"),
    ("contours", "one set a pose", "polylines [m]"),
    ("focal points", "10,000 a second", "x y z, intensity"),
    ("drives", "10,000 a second", "delay, amplitude"),
    ("frames", "10,000 a second", "512 bytes"),
)
NAMES = ("intersection", "sampling", "drive", "codec")


def _way() -> str:
    """Five boxes, and what leads from each to the next."""
    width, gap = 120, 84
    parts = []
    for k, lines in enumerate(STEPS):
        x = MARGIN + k * (width + gap)
        parts.append(f'<rect x="{x}" y="20" width="{width}" height="74" rx="6" fill="#e0f2f1" stroke="#00796b"/>')
        for row, line in enumerate(lines):
            bold = ' font-weight="bold"' if row == 0 else ""
            parts.append(f'<text x="{x + width / 2:g}" y="{42 + 20 * row}" text-anchor="middle"{bold}>{line}</text>')
        if k < len(NAMES):
            at = x + width
            parts.append(f'<path d="M{at + 6} 57h{gap - 18}l-7 -5m7 5l-7 5" fill="none" stroke="#424242"/>')
            parts.append(f'<text x="{at + gap / 2:g}" y="47" text-anchor="middle">{NAMES[k]}</text>')
    return _svg(len(STEPS) * (width + gap) - gap + 2 * MARGIN, 114, "\n".join(parts))


if __name__ == "__main__":
    main()
