"""Contour files that go into one picture: opened, refused where they are unlike, labelled; and the poses to show."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.rigid import rotate
from ..errors import StrategyError
from ..user_warnings import warn_user
from ..validation import value_text
from .rendering_labels import labels_of, short_text
from .scene_drawing import SceneSource
from .scene_view import SceneView
from .shown_moments import MotionMoments, distinct_poses, poses_at

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
