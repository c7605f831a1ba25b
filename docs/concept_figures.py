"""Draws the figures of docs/concepts/ and docs/gallery.md from what palpate computes: `python docs/concept_figures.py`.

A test compares the files with what this draws.
"""

import re
from collections.abc import Iterable
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from palpate.render import MeshObject, Palm, RenderedBatch, render, static_pose

DOCS = Path(__file__).parent
SIDE = 0.085  # of the palm [m]
POSE = (0.04, 0.0, 0.2)  # of the palm: over a tube, at its rim [m]
SCALE = 1600.0  # pixels a metre
PANEL, MARGIN, CAPTION = 190, 16, 40  # [pixel]
KINDS = {
    0: "#b1121f",
    1: "#3d9be0",
    2: "#6a4c93",
}  # on the object, on the palm's edge, made by a stage
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
        (DOCS / name).write_text(text)


def figures() -> dict[str, str]:
    """The figures as SVG, by their path in docs/."""
    return gallery() | {
        "concepts/intersection.svg": picture(
            [_intersection(name) for name in INTERSECTIONS], INTERSECTIONS.values()
        ),
        "concepts/sampling.svg": picture(
            [_cycle(name) for name in SAMPLINGS], SAMPLINGS.values()
        ),
        "concepts/pose-to-wire.svg": _way(),
    }


def gallery() -> dict[str, str]:
    """The pictures of the gallery: each shows the batches `pictures` that the block of code above it leaves."""
    found: dict[str, str] = {}
    names: dict[str, Any] = {}
    text = (DOCS / "gallery.md").read_text()
    for code, path in re.findall(
        r"^```python\n(.*?)^```|^!\[[^\]]*\]\(([^)]+)\)", text, re.MULTILINE | re.DOTALL
    ):
        if path:
            panels = [_on_palm(batch) for batch in names["pictures"]]
            found[path] = picture(panels, names["poses"], letters=17)
        else:
            exec(code, names)
    return found


def _on_palm(batch: RenderedBatch) -> str:
    """The contours of a palm's one pose, seen from the back of the hand, fingers up: hue by kind, pale where weak."""
    (pose,) = batch.motion.pose
    across, back, along = (_turned(pose[3:], axis) for axis in np.eye(3))
    middle = batch.points - pose[:3]
    assert np.abs(middle @ back).max(initial=0) < 1e-4  # [m]: on the palm
    places = np.stack([middle @ across, middle @ along], axis=1)
    intensity = np.ones(len(places)) if batch.intensity is None else batch.intensity
    parts = []
    for first, stop in pairwise(batch.polyline_start):
        looks = [
            (
                KINDS[int(batch.kind[k])],
                round(max(0.15, (intensity[k] + intensity[k + 1]) / 2), 1),
            )
            for k in range(first, stop - 1)
        ]
        for (colour, opacity), run in groupby(range(len(looks)), key=looks.__getitem__):
            ends = list(run)
            parts.append(
                _line(
                    places[first + ends[0] : first + ends[-1] + 2], colour, 2, opacity
                )
            )
    return _palm() + "".join(parts)


def _turned(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """A vector turned by a quaternion xyzw."""
    axis, scalar = quaternion[:3], quaternion[3]
    twice = 2 * np.cross(axis, vector)
    return vector + scalar * twice + np.cross(axis, twice)


def picture(panels: list[str], captions: Iterable[str], letters: int = 12) -> str:
    """Panels side by side, each over its caption; letters: their size [pixel]."""
    parts = []
    for k, (panel, caption) in enumerate(zip(panels, captions, strict=True)):
        parts.append(
            f'<g transform="translate({MARGIN + k * (PANEL + MARGIN)} {MARGIN})">'
        )
        parts.append(f'<svg width="{PANEL}" height="{PANEL}">{panel}</svg>')
        parts.append(
            f'<text x="{PANEL / 2:g}" y="{PANEL + 22}" text-anchor="middle">{caption}</text></g>'
        )
    width = len(panels) * (PANEL + MARGIN) + MARGIN
    return _svg(width, PANEL + MARGIN + CAPTION, "\n".join(parts), letters)


def _svg(width: float, height: float, content: str, letters: int = 12) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" '
        f'viewBox="0 0 {width:g} {height:g}" font-family="sans-serif" font-size="{letters}">\n'
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
    batch = render(
        MeshObject.load("tube"), Palm(SIDE, SIDE), static_pose(list(POSE)), strategy
    )
    starts = batch.polyline_start
    lines = [batch.points[a:b] for a, b in pairwise(starts)]
    kinds = [batch.kind[a : b - 1] for a, b in pairwise(starts)]
    return [line[:, [0, 1]] - np.array([POSE[0], POSE[1]]) for line in lines], kinds


def _cycle(sampling: str) -> str:
    """Every fifth focal point of one cycle, from pale to dark, joined in their order."""
    batch = render(
        MeshObject.load("tube"), Palm(SIDE, SIDE), static_pose(list(POSE)), "oc"
    )
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


def _line(points: np.ndarray, colour: str, width: float, opacity: float = 1.0) -> str:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in _pixels(points))
    pale = f' stroke-opacity="{opacity:.2f}"' if opacity < 1 else ""
    return f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}"{pale}/>'


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
        parts.append(
            f'<rect x="{x}" y="20" width="{width}" height="74" rx="6" fill="#e0f2f1" stroke="#00796b"/>'
        )
        for row, line in enumerate(lines):
            bold = ' font-weight="bold"' if row == 0 else ""
            parts.append(
                f'<text x="{x + width / 2:g}" y="{42 + 20 * row}" text-anchor="middle"{bold}>{line}</text>'
            )
        if k < len(NAMES):
            at = x + width
            parts.append(
                f'<path d="M{at + 6} 57h{gap - 18}l-7 -5m7 5l-7 5" fill="none" stroke="#424242"/>'
            )
            parts.append(
                f'<text x="{at + gap / 2:g}" y="47" text-anchor="middle">{NAMES[k]}</text>'
            )
    return _svg(len(STEPS) * (width + gap) - gap + 2 * MARGIN, 114, "\n".join(parts))


if __name__ == "__main__":
    main()
