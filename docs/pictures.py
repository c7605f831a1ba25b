"""Makes the pictures of the documents again, or checks that they are what the code draws.

    python docs/pictures.py                    # all of them, some minutes
    python docs/pictures.py guide/dog.png      # one
    python docs/pictures.py --check            # exit 1 where a picture is not what the code draws

A picture carries what was drawn: each artist's kind, colour, extent in its axes, and each text. The check draws the
figure again and compares that, with a tolerance. Pixels are not compared: they depend on matplotlib's version.
"""

import argparse
import io
import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib.collections import Collection, LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from PIL import Image, PngImagePlugin

from palpate.render import (
    IntersectionStrategy,
    MeshObject,
    Palm,
    exploration,
    load_strategy,
    record,
    sweep,
)
from palpate.render.reports.contour_figure import contour_figure
from palpate.render.reports.strategy_figure import presets_figure, strategies_figure
from palpate.render.runtime.warp_start import start_warp
from palpate.render.study.analysis import figures as study_figures
from palpate.render.study.analysis.answer_measures import choice_measures
from palpate.render.sweeps.report.figure import sweep_figure

DOCS = Path(__file__).parent
DPI = 120
DRAWN = "palpate drawn"  # key of the picture's text
TOLERANCE = 2e-3  # of an axes' span, by which extents may differ
SHOWN = ("OC", "CC")


def block(page: str, language: str, number: int = 0) -> str:
    """A block of code of a page."""
    blocks = re.findall(
        rf"^```{language}\b[^\n]*\n(.*?)^```",
        (DOCS / page).read_text(),
        re.MULTILINE | re.DOTALL,
    )
    return blocks[number]


def dog() -> Figure:
    """Open and closed contours of the README's dog."""
    mesh, hand = MeshObject.load("dog"), Palm(0.085, 0.1)
    motion = exploration(mesh, duration=30.0, rate=90.0, seed=1)
    with tempfile.TemporaryDirectory() as folder:
        files = {name: Path(folder) / f"{name}.h5" for name in SHOWN}
        for name, path in files.items():
            record(
                path, mesh, hand, motion, load_strategy(name.lower()), devices=["cpu"]
            )
        return contour_figure(files)


def strategies() -> Figure:
    """All presets."""
    return presets_figure()


def own_strategy() -> Figure:
    """The JSON example of the page on strategies."""
    return strategies_figure(
        {"mine": IntersectionStrategy.from_json(block("guide/strategies.md", "json"))}
    )


def sweep_of_page() -> Figure:
    """The plan of the page on sweeps; without the version of the code, which changes with each line."""
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder) / "study.toml"
        plan.write_text(block("guide/sweep.md", "toml"))
        columns = dict(sweep(plan, device="cpu").columns)
        del columns["maker"]
        return sweep_figure(columns, name="study")


def simulated_people() -> Figure:
    """The picture that a report has of p_cc, of the paper's study by 18 simulated people; it says that they are."""
    with benchmarks():
        from simulated_study import PEOPLE, ObservedTables, paper_plan
    table = ObservedTables(paper_plan()).table(PEOPLE["as in the paper"](1), 1)
    (measure,) = choice_measures(table)
    drawn_figures: list[Figure] = []

    def take(figure: Figure, kind: str, *, dpi: float) -> bytes:
        drawn_figures.append(figure)
        return b""

    with patch.object(study_figures, "picture_bytes", take):  # a report has bytes alone
        study_figures.draw_measure(measure, "object", "opacity")
    (figure,) = drawn_figures
    figure.suptitle("simulated people, not measured")
    return figure


def scaling() -> Figure:
    """How sweeps scale, from the measured figures beside the picture."""
    with benchmarks():
        from sweep_projection import projection_figure
    figures = json.loads((DOCS / "measured/sweep-scaling.json").read_text())
    return projection_figure(figures["measured"], figures["poses"], figures["parent"])


@contextmanager
def benchmarks() -> Iterator[None]:
    """Modules of benchmarks/ can be imported within."""
    before = list(sys.path)
    sys.path.insert(0, str(DOCS.parent / "benchmarks"))
    try:
        yield
    finally:
        sys.path[:] = before  # benchmarks may have added folders of tests


PICTURES: dict[str, Callable[[], Figure]] = {
    "guide/dog.png": dog,
    "guide/strategies.png": strategies,
    "guide/own-strategy.png": own_strategy,
    "guide/sweep.png": sweep_of_page,
    "measured/sweep-scaling.png": scaling,
    "tutorial/simulated-people.png": simulated_people,
}


ELSEWHERE: tuple[str, ...] = (
    *(f"concepts/{name}.svg" for name in ("intersection", "sampling", "pose-to-wire")),
    *(
        f"gallery/{name}.svg"
        for name in (
            "oc",
            "cc",
            "hatch",
            "inset",
            "corners",
            "depth-hatch",
            "ellipse",
            "mammoth",
        )
    ),
)
"""Pictures of pages that `python docs/concept_figures.py` makes."""


def write(name: str) -> None:
    """Draw a picture and what was drawn into its file."""
    figure = PICTURES[name]()
    info = PngImagePlugin.PngInfo()
    content = io.BytesIO()
    figure.savefig(
        content, dpi=DPI, format="png"
    )  # before `drawn`: layout and limits are settled by drawing
    info.add_text(DRAWN, json.dumps(drawn(figure)), zip=True)
    with Image.open(content) as image:
        image.convert("RGB").save(DOCS / name, pnginfo=info, optimize=True)


def problems(name: str) -> list[str]:
    """What differs between a committed picture and what the code draws, a sentence each."""
    figure = PICTURES[name]()
    figure.savefig(io.BytesIO(), dpi=DPI, format="png")
    with Image.open(DOCS / name) as image:
        text = getattr(image, "text", {}).get(DRAWN)
        size = image.size
    if text is None:
        return [f"{name} does not carry what was drawn"]
    expected = tuple(int(DPI * side) for side in figure.get_size_inches())
    wrong = (
        []
        if np.abs(np.subtract(size, expected)).max() <= 1
        else [f"{name}: {size} pixels, not {expected}"]
    )
    return wrong + [
        f"{name}: {sentence}"
        for sentence in differences(json.loads(text), drawn(figure))
    ]


def drawn(figure: Figure) -> list[dict[str, Any]]:
    """Everything that a figure shows but ticks, in the order in which it was added."""
    entries: list[dict[str, Any]] = [
        {"kind": "text", "text": text.get_text()}
        for text in figure.texts
        if text.get_text()
    ]
    for legend in figure.legends:
        entries += [
            {"kind": "legend", "text": text.get_text()} for text in legend.get_texts()
        ]
    for number, axes in enumerate(figure.axes):
        spans = [axes.get_xlim(), axes.get_ylim()]
        corner, size = np.array(
            [[low, abs(high - low)] for low, high in map(sorted, spans)]
        ).T
        for artist in (*axes.get_children(), *_legend_texts(axes)):
            if artist is axes.patch:
                continue
            for entry in _entries(artist):
                if "extent" in entry:
                    extent = (np.array(entry["extent"]) - corner) / size
                    entry["extent"] = np.round(extent, 4).ravel().tolist()
                entries.append({"axes": number, **entry})
    return entries


def _legend_texts(axes: Any) -> list[Text]:
    return [] if axes.get_legend() is None else axes.get_legend().get_texts()


def _entries(artist: Any) -> Iterator[dict[str, Any]]:
    """What an artist shows: its kind, colour, extent in the units of its axes, and text."""
    if isinstance(artist, Text) and artist.get_text():
        yield {"kind": "text", "text": artist.get_text()}
    elif isinstance(artist, Line2D):
        points = np.array(artist.get_xydata(), float)
        yield {
            "kind": "line",
            "colour": to_hex(artist.get_color()),
            **_extent(points, artist),
        }
    elif isinstance(artist, Collection):
        paths = artist.get_paths()
        points = np.concatenate([*(path.vertices for path in paths), np.zeros((0, 2))])
        colours = (
            artist.get_edgecolor()
            if isinstance(artist, LineCollection)
            else artist.get_facecolor()
        )
        mean = (
            np.asarray(colours).reshape(-1, 4).mean(axis=0)
            if len(colours)
            else np.zeros(4)
        )
        yield {
            "kind": type(artist).__name__,
            "colour": to_hex(mean.tolist()),
            **_extent(points, artist),
        }
    elif isinstance(artist, Patch) and artist.get_visible():
        points = np.array(artist.get_path().vertices)
        yield {
            "kind": "patch",
            "colour": to_hex(artist.get_facecolor()),
            **_extent(points, artist),
        }


def _extent(points: np.ndarray, artist: Any) -> dict[str, Any]:
    """Lowest, highest and mean place of points in the units of the axes, where they are in these units."""
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points) or not artist.get_transform().contains_branch(
        artist.axes.transData
    ):
        return {}
    ends = [points.min(axis=0).tolist(), points.max(axis=0).tolist()]
    return {
        "extent": [*ends, points.mean(axis=0).tolist()]
        if isinstance(artist, Line2D)
        else ends
    }


def differences(stored: list[dict[str, Any]], made: list[dict[str, Any]]) -> list[str]:
    """Sentences on what was drawn once and is drawn otherwise now; the first ten."""
    wrong = (
        []
        if len(stored) == len(made)
        else [f"{len(stored)} marks and texts, now {len(made)}"]
    )
    for old, new in zip(stored, made, strict=False):
        old_extent, new_extent = (
            np.array(entry.get("extent", []), float) for entry in (old, new)
        )
        same = {**old, "extent": None} == {
            **new,
            "extent": None,
        } and old_extent.shape == new_extent.shape
        if not same or (
            len(old_extent) and np.abs(old_extent - new_extent).max() > TOLERANCE
        ):
            wrong.append(f"was {json.dumps(old)}, is {json.dumps(new)}")
    return wrong[:10]


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"pictures; all: {', '.join(PICTURES)}"
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="compare, and exit with 1 where one differs",
    )
    options = parser.parse_args()
    if unknown := set(options.names) - set(PICTURES):
        parser.error(
            f"unknown picture {sorted(unknown)[0]!r}; known: {', '.join(PICTURES)}"
        )
    start_warp()
    wrong: list[str] = []
    for name in options.names or PICTURES:
        if options.check:
            wrong += problems(name)
        else:
            write(name)
    sys.exit("\n".join(wrong) or None)


if __name__ == "__main__":
    main()
