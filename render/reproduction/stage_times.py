"""Section 4.3.1: time of the stages per 100 faces, on one core of this machine."""

from typing import NamedTuple

import numpy as np

from ..bench.speed import OwnTurn, timed
from ..hands.hand import Palm
from ..intersection.prepared_contours import PreparedContours
from ..objects.mesh.solid_mesh import MeshObject
from ..reports.report_pages import ReportSection, ReportTable
from ..scripting.rendered_batch import render
from ..strategies.intersection_strategy import IntersectionStrategy, closed_contour, open_contour
from .explorations import explorer_motion
from .paper_numbers import CLOSE_SECONDS, PRUNE_SECONDS, RAW_SECONDS, ReportRow, compared

MESHES = ("cube", "tube", "dog", "dog-detailed")
SHOWN = "tube"
"""The mesh of the rows: the largest whose triangles the paper gives for what hands feel."""
STEPS = {
    "raw": IntersectionStrategy(),
    "raw_prune": open_contour(),
    "raw_prune_close": closed_contour(),
}
LIVE_POSES, BATCH_POSES = 300, 10_000
REPEATS = 7
TEXT = (
    "Poses of explorations that meet the object, one after the other as in the paper's program, and many in one go; "
    "medians of {repeats} repetitions by turns, on one core of {cpu}. Contours only, in memory that is used again. "
    "palpate prunes and closes while it follows the section, so a stage has no time of its own: pruning is the "
    "difference between OC and the raw section, closing the one between CC and OC, and either can be below 0."
)


class StepTimes(NamedTuple):
    """Seconds a pose of raw section, OC and CC of one mesh."""

    faces: int
    live: dict[str, np.ndarray]
    """One pose after the other, by step; shape [repetition]."""
    batch: dict[str, np.ndarray]
    """Many poses in one go."""


def measure_steps(mesh: MeshObject, palm: Palm, *, live_poses: int, batch_poses: int, repeats: int) -> StepTimes:
    """Time the steps on poses of the first explorer at which the palm meets the object."""
    pose = explorer_motion(mesh, 0, 0).pose
    met = pose[render(mesh, palm, pose, closed_contour()).length() > 0.0]
    met = met if len(met) else pose
    few, many = np.resize(met, (live_poses, 7)), np.resize(met, (batch_poses, 7))
    live = [_LiveTurn(PreparedContours(mesh, palm, strategy), few) for strategy in STEPS.values()]
    batch = [OwnTurn(mesh, palm, many, strategy, "cpu") for strategy in STEPS.values()]
    for call in (*live, *batch):
        call()
    taken = np.array([[timed(call)[1] for call in (*live, *batch)] for _ in range(repeats)]).T
    count = len(STEPS)
    return StepTimes(
        len(mesh.faces),
        {step: seconds / live_poses for step, seconds in zip(STEPS, taken[:count], strict=True)},
        {step: seconds / batch_poses for step, seconds in zip(STEPS, taken[count:], strict=True)},
    )


class _LiveTurn:
    """Contours of poses, one after the other."""

    def __init__(self, contours: PreparedContours, pose: np.ndarray) -> None:
        self._contours, self._rows = contours, list(pose)

    def __call__(self) -> None:
        for row in self._rows:
            self._contours.at_checked(row)


def time_section(times: dict[str, StepTimes], cpu: str) -> tuple[ReportSection, dict]:
    """The section, and its values for JSON: seconds a pose by mesh."""
    found = times[SHOWN]
    per = 100.0 / found.faces
    rows = tuple(
        ReportRow(what, f"{_ms(seconds)} ms{unit}", _both(found, scale, *between), why)
        for what, seconds, unit, scale, between, why in (
            ("raw intersection", RAW_SECONDS, " per 100 faces", per, ("raw", None), _WHY_RAW),
            ("pruning", PRUNE_SECONDS, " per 100 faces", per, ("raw_prune", "raw"), _WHY_PRUNE),
            ("closing", CLOSE_SECONDS, " at most, in all", 1.0, ("raw_prune_close", "raw_prune"), _WHY_CLOSE),
        )
    )
    table = ReportTable(
        "Time of one pose [us], and of 100 faces [ms] with CC (medians)",
        ("mesh", "faces", "poses", "raw section", "OC", "CC", "CC, 100 faces"),
        tuple(row for name, one in times.items() for row in _mesh_rows(name, one)),
    )
    text = TEXT.format(repeats=REPEATS, cpu=cpu)
    values = {
        name: {"faces": one.faces, "live": _medians(one.live), "batch": _medians(one.batch)}
        for name, one in times.items()
    }
    return ReportSection("Section 4.3.1: computation time", text, (compared(rows), table)), {"stage_seconds": values}


def _medians(taken: dict[str, np.ndarray]) -> dict[str, float]:
    return {step: float(np.median(seconds)) for step, seconds in taken.items()}


_WHY_RAW = (
    f"Mesh: {SHOWN}. The paper's is, in its words, a naive implementation in C#; palpate follows the "
    "section from face to face, so its time grows more slowly than the number of faces. Of one pose by itself, the "
    "call from Python takes most of the time."
)
_WHY_PRUNE = (
    f"Mesh: {SHOWN}. The middle half of the differences of all repetitions. palpate clips while it follows the "
    "section, and never writes what lies outside the palm."
)
_WHY_CLOSE = f"Mesh: {SHOWN}, one pose in all. Differences as above. Done in the same pass."


def _both(found: StepTimes, scale: float, step: str, before: str | None) -> str:
    """One pose after the other, and in one go."""
    texts = []
    for taken in (found.live, found.batch):
        if before is None:
            texts.append(f"{_ms(scale * float(np.median(taken[step])))} ms")
        else:
            off = scale * (taken[step] - taken[before])
            low, high = np.quantile(off, [0.25, 0.75]).tolist()
            texts.append(f"{_ms(low)} to {_ms(high)} ms")
    return f"{texts[0]} one by one; {texts[1]} in one go"


def _ms(seconds: float) -> str:
    """Milliseconds of two digits, to a hundredth of a microsecond."""
    return np.format_float_positional(round(1e3 * seconds, 5) + 0.0, precision=2, fractional=False, trim="-")


def _mesh_rows(name: str, one: StepTimes) -> list[tuple[str, ...]]:
    ways = (("one by one", one.live), ("in one go", one.batch))
    return [
        (
            name,
            f"{one.faces:,}",
            way,
            *(f"{1e6 * np.median(taken[step]):.2f}" for step in STEPS),
            _ms(float(np.median(taken["raw_prune_close"])) * 100.0 / one.faces),
        )
        for way, taken in ways
    ]
