"""Strategies side by side: each renders the same object and palm, and the renderings are one figure."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ..errors import StrategyError
from ..hands.hand import Palm
from ..intersection.file_recording import record
from ..objects.mesh.solid_mesh import MeshObject
from ..stages.registry import find_stage, first_line
from ..strategies.intersection_strategy import PRESET_LINES, PRESETS, IntersectionStrategy
from .contour_figure import contour_figure
from .picture_style import require_picture, save_figure

STRATEGIES_MOST = 12
FILES_MOST = 64  # all presets, and those that a user adds
POSE = np.array([[0.0, 0.0, 0.2, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]], np.float32)  # palm down, 20 cm high
ANGLE = [(-60, -30), (32, -30), (32, 0), (0, 0), (0, 52), (-60, 52)]  # [mm]; two legs, wider than the palm
HOLE, PEG = (12.0, (-22.0, 17.0)), (11.0, (24.0, 25.0))  # [mm] radius and middle
HEIGHT = 60.0  # [mm]


def strategy_rows() -> list[tuple[str, str]]:
    """Every preset by name, with what it draws in one line."""
    return [(name, PRESET_LINES.get(name) or first_line(make)) for name, make in PRESETS.items()]


def shown_object() -> MeshObject:
    """An angle with a hole and a peg beside it: its section has corners, arcs and two regions."""
    from manifold3d import CrossSection, FillRule

    discs = [CrossSection.circle(radius, 48).translate(middle) for radius, middle in (HOLE, PEG)]
    flat = CrossSection([ANGLE], FillRule.Positive) - discs[0] + discs[1]
    mesh = flat.extrude(HEIGHT).translate((0.0, 0.0, 1e3 * float(POSE[0, 2]) - 0.5 * HEIGHT)).to_mesh()
    return MeshObject(1e-3 * np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts), name="angle and peg")


def draw_strategies(
    picture: Path, strategies: Mapping[str, IntersectionStrategy] | None, *, overwrite: bool = False
) -> None:
    """Draw strategies by name into a PNG, SVG or PDF, each after its raw intersection; None: all presets.

    Raises StrategyError for no strategy, more than STRATEGIES_MOST, another kind of picture, and one that is there
    unless `overwrite`; ContourFileError where it cannot be written.
    """
    require_picture(picture, overwrite=overwrite)
    save_figure(presets_figure() if strategies is None else strategies_figure(strategies), picture, in_print=False)


def presets_figure() -> Any:
    """All presets, with what they draw, as a matplotlib figure."""
    lines = dict(strategy_rows())
    return _figure([(name, line, PRESETS[name]()) for name, line in lines.items()])


def strategies_figure(strategies: Mapping[str, IntersectionStrategy]) -> Any:
    """Strategies and their stages, each after its raw intersection unless that is shown, as a matplotlib figure."""
    if not 1 <= len(strategies) <= STRATEGIES_MOST:
        raise StrategyError(f"a picture shows 1 to {STRATEGIES_MOST} strategies, not {len(strategies)}")
    shown: list[tuple[str, str, IntersectionStrategy]] = []
    for name, strategy in strategies.items():
        raw = IntersectionStrategy(raw=strategy.raw_stage, step=strategy.step, modules=strategy.modules)
        if all(before != raw for _, _, before in shown):
            line = find_stage("raw", raw.raw_stage.name).line
            shown.append((name if strategy == raw else f"raw: {raw.raw_stage.name}", line, raw))
        if strategy != raw:
            shown.append((name, stages_text(strategy), strategy))
    return _figure(shown)


def stages_text(strategy: IntersectionStrategy) -> str:
    """The stages after the raw intersection with their options, as `close + inset, distance 0.004 m`."""
    parts = []
    for role in ("prune", "transform"):
        for stage in strategy.stages()[role]:
            options = find_stage(role, stage.name).options
            values = [
                f", {key} {f'{value:.3g}' if isinstance(value, float) else value} {options[key].unit}".rstrip()
                for key, value in stage.options.items()
            ]
            parts.append(stage.name + "".join(values))
    return " + ".join(parts)


def _figure(shown: Sequence[tuple[str, str, IntersectionStrategy]]) -> Any:
    """Strategies with their titles and notes, as one figure of their renderings."""
    solid = shown_object()
    with TemporaryDirectory(prefix="palpate-") as folder:
        files: dict[str, Path] = {}
        for k, (title, _, strategy) in enumerate(shown):
            path = Path(folder) / f"{k}.h5"
            record(path, solid, Palm(), HandMotion(None, POSE), strategy, devices=["cpu"])
            files[title if title not in files else f"{title} ({k})"] = path
        notes = [note for _, note, _ in shown]
        return contour_figure(files, view="palm", array=None, notes=notes, files_most=FILES_MOST)
