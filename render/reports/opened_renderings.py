"""Contour files that go into one picture: opened, refused where they are unlike, labelled; and the poses to show."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.rigid import rotate
from ..errors import StrategyError
from ..user_warnings import warn_user
from ..validation import value_text
from .rendering_labels import labels_of, short_text
from .scene_drawing import SceneSource, SceneView

CANDIDATES = 48  # poses of which distinct ones are chosen: the best of so many equal ranges of poses
APART = 0.02  # [m] by which two poses differ at least, in the places of the palm's corners and of the contours on it
MOMENTS_MOST = 6
SPREAD = 0.1  # [m] of difference that the whole duration between two poses counts as
CORNERS = 0.0425 * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], np.float64)  # [m], hand frame
SAMPLED = 64  # points of a pose's contours that are compared

ContoursOf = Callable[[int], np.ndarray]
"""Points of a pose's contours [m], array frame, shape [point, 3]."""


class MotionMoments(NamedTuple):
    """The poses that can be shown."""

    pose: np.ndarray
    """Of the hand, shape [pose, 7]."""
    time: np.ndarray | None
    """[s], shape [pose]; None for poses without times."""

    def at(self, index: int) -> float:
        """Time of a pose [s], or its number."""
        return float(index) if self.time is None else float(self.time[index])

    def text(self, index: int) -> str:
        """Time or number of a pose, for titles."""
        return f"pose {index}" if self.time is None else f"{self.time[index]:.2f} s"


def poses_at(times: Sequence[float], moments: MotionMoments, name: str) -> np.ndarray:
    """The poses that are nearest to times [s], or with these numbers where poses have no times; in order.

    name: of the file, for messages. Raises StrategyError for no time, more than MOMENTS_MOST, one outside the motion,
    and two of the same pose.
    """
    if not 1 <= len(times) <= MOMENTS_MOST:
        raise StrategyError(f"a picture shows 1 to {MOMENTS_MOST} moments, not {len(times)}: draw several pictures")
    count = len(moments.pose)
    where = np.arange(count, dtype=float) if moments.time is None else moments.time
    what, unit = ("pose", "") if moments.time is None else ("time", " s")
    chosen: list[int] = []
    for given in sorted(float(time) for time in times):
        if not (math.isfinite(given) and where[0] <= given <= where[-1]):
            raise StrategyError(
                f"{what} {given:g}{unit} is outside {name}, which has {what}s {where[0]:g} to {where[-1]:g}{unit}"
            )
        if moments.time is None and given != int(given):
            raise StrategyError(f"{name} has no times, so moments are numbers of poses, not {given:g}")
        nearest = int(np.argmin(np.abs(where - given)))
        if nearest in chosen:
            raise StrategyError(f"{what} {given:g}{unit} shows pose {nearest} again: leave out one of the two")
        chosen.append(nearest)
    return np.array(chosen)


def distinct_poses(worth: np.ndarray, moments: MotionMoments, contours_of: ContoursOf, count: int) -> np.ndarray:
    """At most `count` poses of much worth that differ from each other in pose and contour; in order.

    worth: of showing a pose, at least 0, shape [pose]. The first pose that is chosen is that of most worth. Each other
    one is the one whose worth (its root) times its distance from those chosen, in place, contour and time, is largest.
    Poses nearer than APART are not chosen. The first pose if none is worth anything.
    """
    ranges = np.array_split(np.arange(len(worth)), min(CANDIDATES, len(worth)))
    best = np.array([part[np.argmax(worth[part])] for part in ranges])
    best = best[worth[best] > 0]
    if not len(best):
        return np.zeros(1, int)
    placed = moments.pose[best][:, None]
    corners = placed[..., :3] + rotate(np.asarray(placed[..., 3:], np.float64), CORNERS[None])
    contours = [_on_palm(contours_of(int(i)), moments.pose[i]) for i in best]
    share = np.sqrt(worth[best] / worth[best].max())
    chosen = [int(np.argmax(share))]
    apart, spread = np.full(len(best), np.inf), np.full(len(best), np.inf)
    while len(chosen) < min(count, len(best)):
        latest = chosen[-1]
        moved = np.linalg.norm(corners - corners[latest], axis=2).mean(axis=1)
        later = SPREAD * np.abs(best - best[latest]) / len(worth)
        changed = np.array([_distance(own, contours[latest]) for own in contours])
        apart = np.minimum(apart, moved + 2.0 * changed)
        spread = np.minimum(spread, later)
        gain = np.where(apart >= APART, share * (apart + spread), 0.0)
        if not gain.any():
            break
        chosen.append(int(np.argmax(gain)))
    return np.sort(best[chosen])


def _on_palm(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Some points of a pose's contours in the hand's frame [m], shape [point, 3]."""
    some = points[np.linspace(0, len(points) - 1, min(SAMPLED, len(points))).astype(int)] if len(points) else points
    back = np.asarray(pose[3:], np.float64) * [-1, -1, -1, 1]
    return rotate(back, np.asarray(some, np.float64) - pose[:3])


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    """Mean distance of each of two sets of points from the other [m]."""
    if not len(a) or not len(b):
        return 0.0 if len(a) == len(b) else 0.085
    apart = np.linalg.norm(a[:, None] - b[None], axis=2)
    return float(apart.min(axis=1).mean() + apart.min(axis=0).mean()) / 2


POSES_SHOWN = 3
FILES_MOST = 8


@dataclass(frozen=True)
class Renderings:
    """Open files of one object and motion, and what a picture of them needs."""

    labels: list[str]
    sources: list[SceneSource]
    lengths: list[np.ndarray]
    """Of each file, of each pose's contours [m]; NaN where a pose is not done yet."""
    moments: MotionMoments

    @property
    def across(self) -> np.ndarray:
        """Times [s], or numbers of poses."""
        return np.arange(len(self.moments.pose)) if self.moments.time is None else self.moments.time

    def require_done(self, poses: np.ndarray) -> None:
        """Raise StrategyError where a file lacks one of these poses."""
        for source, length in zip(self.sources, self.lengths, strict=True):
            if len(missing := poses[np.isnan(length[poses])]):
                when = self.moments.text(int(missing[0]))
                raise StrategyError(f"{source.file.path}: {when} is not done yet; palpate render --resume goes on")


def opened(
    paths: Mapping[str, str | Path] | Sequence[str | Path], stack: ExitStack, most: int = FILES_MOST
) -> Renderings:
    """Open files, which `stack` closes; raises StrategyError for none, too many, and files that do not fit together."""
    files = [stack.enter_context(ContourFile(path)) for path in files_of(paths)]
    if len(files) > most:
        raise StrategyError(f"a picture shows up to {most} files, not {len(files)}: draw several pictures")
    _refuse_unlike(files)
    labels = [short_text(str(label)) for label in paths] if isinstance(paths, Mapping) else labels_of(files)
    for file in files:
        if not file.done:
            raise StrategyError(f"{file.path}: no pose is done yet; palpate render --resume goes on")
        if not file.polyline_count:
            warn_user(f"{file.path} holds no contour: the picture shows object and hand only")
    motion = files[0].motion()
    moments = MotionMoments(motion["pose"], motion.get("time"))
    return Renderings(labels, [SceneSource.of(file) for file in files], [_lengths(file) for file in files], moments)


def files_of(paths: Mapping[str, str | Path] | Sequence[str | Path]) -> list[Path]:
    """The files that are given in a list or by label; raises StrategyError for none, and for a text."""
    if isinstance(paths, str | Path) or not paths:
        raise StrategyError(f"files must be given by label, as in {{'closed': 'tube.h5'}}, not {value_text(paths)}")
    return [Path(path) for path in (paths.values() if isinstance(paths, Mapping) else paths)]


def _refuse_unlike(files: list[ContourFile]) -> None:
    """Refuse files whose lengths cannot stand in one diagram."""
    first = files[0]
    for file in files:
        for field in ("object", "representation", "motion", "object motion"):  # some files have only two of them
            if file.recipe.get(field) != first.recipe.get(field):
                raise StrategyError(
                    f"{file.path} is of another {field} than {first.path}: they do not belong in one picture"
                )


def _lengths(file: ContourFile) -> np.ndarray:
    length = np.full(file.pose_count, np.nan)
    for first, stop in file.done:
        length[first:stop] = file.metrics(first, stop)["length"]
    return length


def shown_poses(renderings: Renderings, times: Sequence[float] | None, view: SceneView) -> np.ndarray:
    """Poses at the times that are asked for, or distinct ones; in order.

    Raises StrategyError where none of the times asked for has a contour, or a pose is not done yet; warns of one time
    without contour.
    """
    moments, lengths = renderings.moments, np.array(renderings.lengths)
    if times is None:
        # Worth showing: contours as long as possible in every file, seen as squarely as possible.
        share = np.nan_to_num(lengths) / np.maximum(np.nan_to_num(lengths).max(axis=1, keepdims=True), 1e-12)
        in_all = share.min(axis=0)
        worth = in_all if in_all.any() else share.sum(axis=0)
        worth = worth * view.facing(rotate(moments.pose[:, 3:].astype(np.float64), np.array([0.0, 1.0, 0.0])))
        return distinct_poses(worth, moments, _contours_of(renderings), POSES_SHOWN)
    name = renderings.sources[0].file.path.name
    poses = poses_at(times, moments, name)
    renderings.require_done(poses)
    longest = np.nan_to_num(lengths).max(axis=0)
    bare = poses[longest[poses] == 0]
    if len(bare):
        listed = ", ".join(map(moments.text, bare.tolist()))
        sentence = f"{name}: {listed}: no contour there; {_nearest(longest, moments, bare)}"
        if len(bare) == len(poses):
            raise StrategyError(sentence)
        warn_user(sentence)
    return poses


def _nearest(longest: np.ndarray, moments: MotionMoments, bare: np.ndarray) -> str:
    drawn = np.flatnonzero(longest > 0)
    if not len(drawn):
        return "the hand never meets the object"
    near = drawn[np.argmin(np.abs(drawn - bare[0]))]
    return f"the nearest one is at {moments.text(int(near))}"


def _contours_of(renderings: Renderings) -> Any:
    """A function that gives the points of a pose's contours in the first file that has some."""

    def points(index: int) -> np.ndarray:
        for source, length in zip(renderings.sources, renderings.lengths, strict=True):
            if length[index] > 0:  # a NaN compares false
                return source.batch(index).points
        return np.zeros((0, 3))

    return points
