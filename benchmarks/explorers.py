"""r and facing shares of explorations over an array: persons, workspaces and palms (docs/measured/explorers.md).

r = mean |CC| / mean |OC| as in figure 6C of the founding paper (Mulot et al. 2024). A palm wholly inside an object
counts in CC with its whole boundary (r), or not at all, as the paper closes only contours that are open (r_open).
Nothing is fitted. The last rows turn the palm by habit, or take the model `around`, for comparison.

    python benchmarks/explorers.py --explorers 20
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from palpate.datasets import HandMotion
from palpate.datasets.motions.facing import SHARE_ANGLES, facing_angles
from palpate.datasets.rigid import quaternion_product
from palpate.render import MeshObject, Palm, closed_contour, exploration, explorer_habits, render

OBJECTS = ("cube", "tube", "dog")
DURATION, RATE = 30.0, 90.0  # [s], [Hz]
PAPER_BOX = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])  # [m]


@dataclass(frozen=True)
class ExplorerCase:
    """One row of the table: how persons explore, and with which palm."""

    label: str
    palm: tuple[float, float] | None = (0.085, 0.085)
    """Width and length [m]; None: each person's own."""
    workspace: np.ndarray | None = None
    """Lowest and highest corner [m]; None: the default."""
    pitch: float = 0.0
    """By so much all fingers point further up [rad]."""
    model: str = "over-array"


def box_around(sides: float, above: float, below: float = 0.0) -> np.ndarray:
    """The paper's box grown by so much [m], shape [2, 3]."""
    return PAPER_BOX + np.array([[-sides, -sides, -below], [sides, sides, above]])


UPPER = box_around(0.06, 0.06, -0.065)
CASES = (
    ExplorerCase("default"),
    ExplorerCase("upper half", workspace=UPPER),
    ExplorerCase("60 mm below, too", workspace=box_around(0.06, 0.06, 0.06)),
    ExplorerCase("30 mm instead of 60", workspace=box_around(0.03, 0.03)),
    ExplorerCase("the box alone", workspace=PAPER_BOX),
    ExplorerCase("90 mm instead of 60", workspace=box_around(0.09, 0.09)),
    ExplorerCase("palm 75 x 96 mm", palm=(0.075, 0.096)),
    ExplorerCase("palm 85 x 100 mm", palm=(0.085, 0.1)),
    ExplorerCase("persons' own palms", palm=None),
    ExplorerCase("fingers 30 degrees up", pitch=np.radians(30.0)),
    ExplorerCase("model around", model="around"),
)


@dataclass(frozen=True)
class ExplorerFigures:
    """Figures of an object in a case: one value an explorer."""

    r: np.ndarray
    r_open: np.ndarray
    facing_share: np.ndarray
    """Shares of the poses with contours within SHARE_ANGLES, shape [explorer, angle]."""
    drawn_share: np.ndarray
    inside_share: np.ndarray
    """Share of the poses with contours in which the palm is wholly inside."""


def motion_of(case: ExplorerCase, thing: MeshObject, explorer: int) -> HandMotion:
    """An explorer's motion; of the model `around` the seed stands for the explorer."""
    if case.model == "around":
        return exploration(thing, DURATION, rate=RATE, seed=explorer, model="around")
    motion = exploration(thing, DURATION, rate=RATE, explorer=explorer, workspace=case.workspace)
    if not case.pitch:
        return motion
    pose = motion.pose.astype(np.float64)
    turn = np.array([np.sin(case.pitch / 2), 0.0, 0.0, np.cos(case.pitch / 2)])
    pose[:, 3:] = quaternion_product(pose[:, 3:], np.broadcast_to(turn, (len(pose), 4)))
    return replace(motion, pose=pose)


def measure(case: ExplorerCase, thing: MeshObject, explorers: range) -> ExplorerFigures:
    """Render every explorer's closed contours; lengths by kind give both readings of r."""
    rows = []
    for explorer in explorers:
        motion, person = motion_of(case, thing, explorer), explorer_habits(explorer)
        size = case.palm or (person.palm_width, person.palm_length)
        lengths = render(thing, Palm(*size), motion, closed_contour()).lengths().astype(np.float64)
        drawn, is_inside = lengths.sum(axis=1) > 0, (lengths[:, 0] == 0) & (lengths[:, 1] > 0)
        whole, outline, inside = lengths.sum(), lengths[:, 0].sum(), lengths[is_inside].sum()
        angle = np.degrees(facing_angles(motion.pose[drawn]))
        within = [np.mean(angle <= degrees) for degrees in SHARE_ANGLES]
        rows.append([whole / outline, (whole - inside) / outline, *within, drawn.mean(), is_inside.sum() / drawn.sum()])
    table = np.array(rows)
    return ExplorerFigures(table[:, 0], table[:, 1], table[:, 2:4], table[:, 4], table[:, 5])


def table_rows(cases: tuple[ExplorerCase, ...], explorers: range) -> Iterator[tuple[str, str, ExplorerFigures]]:
    """Every case of every object."""
    things = {name: MeshObject.load(name) for name in OBJECTS}
    for case in cases:
        for name, thing in things.items():
            yield case.label, name, measure(case, thing, explorers)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--explorers", type=int, default=20)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    for label, name, found in table_rows(CASES, range(1, options.explorers + 1)):
        near, far = 100 * found.facing_share.mean(axis=0)
        r, r_open = found.r, found.r_open
        print(
            f"{label:22s} {name:5s} r {r.mean():.2f} +- {r.std(ddof=1):.2f}"
            f"  r_open {r_open.mean():.2f} +- {r_open.std(ddof=1):.2f}  within 30, 60: {near:.0f} {far:.0f} %"
            f"  drawn {100 * found.drawn_share.mean():.0f} %  inside {100 * found.inside_share.mean():.0f} %",
            flush=True,
        )


if __name__ == "__main__":
    main()
