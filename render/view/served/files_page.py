"""The page of one contour file, or of two side by side: each pose is read when the page asks for it."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ...playback.placed_arrays import PlacedArray
from ...terminal.foreign_text import visible
from ..file_scene import FileScene
from ..packing import Packer
from ..page.payload import describe_page, file_names, pack_constants, pack_poses
from ..pressure_print import PLACES, PressurePrinter, pack_prints
from ..series import longest_pose, overview_of, steps_in, window_around
from .page_server import PageRequest, Send

PLOTTED_MOST = 1000
"""Poses that plots show: finding jumps of more would delay a slider that is dragged again meanwhile."""


class FilesPage:
    """Answers for open files, which stay the caller's; it keeps nothing of a page, so that many can be open at once.

    arrays: shown under each file's hand; pressure is predicted for them. titles: more words on each file.

    | a page asks | it gets |
    |---|---|
    | open | what stays the same, and the whole recording in some hundred points |
    | moment: `pose` of the file that lasts longest, or `time` | the pose of each file that is shown then |
    | series: `poses` | length, draw frequency and tilt of the poses around it |
    | news: `done` | how many poses are done, if that are others than `done` says |
    | pressure: `poses`, `where` | prints of pressure |
    """

    slow = frozenset[str]()

    def __init__(self, scenes: Sequence[FileScene], arrays: Sequence[PlacedArray], titles: Sequence[str] = ()) -> None:
        self._scenes, self._arrays, self._titles = list(scenes), tuple(arrays), list(titles)
        self._by_time = all(scene.has_time for scene in scenes)

    def close(self) -> None:
        """Nothing: the files are the caller's."""

    def answer(self, request: PageRequest, send: Send) -> None:
        """Answer one request; raises StrategyError for a request or a value that cannot be."""
        packer = Packer(exact=True)
        match request.choice("ask", ("open", "moment", "series", "news", "pressure")):
            case "open":
                described = self._opened(packer)
            case "moment":
                described = self._moment(request, packer)
            case "series":
                described = self._series(request.integers("poses", len(self._scenes), self._counts), packer)
            case "news":
                described = self._news(request, packer)
            case _:
                described = self._pressure(request, packer)
        send(described, packer)

    @cached_property
    def _counts(self) -> tuple[int, ...]:
        return tuple(scene.pose_count for scene in self._scenes)

    def _opened(self, packer: Packer) -> dict[str, Any]:
        files = [
            pack_constants(scene, packer, name=name)
            for scene, name in zip(self._scenes, file_names(self._scenes), strict=True)
        ]
        models = [placed.model for placed in self._arrays]
        leading = self._scenes[self._leading]
        return {
            "kind": "files",
            **describe_page(files, self._scenes, models, packer),
            "titles": [visible(title) for title in self._titles],
            "timeline": {
                "file": self._leading,
                "count": leading.pose_count,
                "by_pose": not self._by_time,
                "begin": min(self._clock_of(k, 0) for k in range(len(self._scenes))),
                "end": self._clock_of(self._leading, leading.pose_count - 1),
                "start": longest_pose(leading, overview_of(leading)),  # a hand that touches nothing shows little
            },
            **self._progress(packer),
        }

    @cached_property
    def _leading(self) -> int:
        """Number of the file on whose poses the slider stands: the one that lasts longest."""
        return max(range(len(self._scenes)), key=lambda k: (self._clock_of(k, self._counts[k] - 1), -k))

    def _clock_of(self, file: int, pose: int) -> float:
        """What the page's clock shows when a pose of a file begins [s], or the pose where files lack times."""
        time = self._scenes[file].time_of(pose) if self._by_time else None
        return float(pose) if time is None else time

    def _pose_at(self, file: int, clock: float) -> int:
        """Number of the pose that a file shows: the first or the last one outside its motion."""
        if self._by_time:
            return self._scenes[file].pose_at(clock)
        return min(max(int(clock), 0), self._counts[file] - 1)

    def _progress(self, packer: Packer) -> dict[str, Any]:
        described: dict[str, Any] = {
            "names": [visible(name) for name in file_names(self._scenes)],
            "done": [scene.done_count for scene in self._scenes],
            "is_sealed": all(scene.is_sealed for scene in self._scenes),
            "overview": None,  # plots show all poses
        }
        if max(self._counts) > PLOTTED_MOST:
            described["overview"] = [
                {
                    "time": packer.numbers(each.time if self._by_time else each.pose, "f8"),
                    "length": packer.numbers(each.longest, "f4"),
                }
                for each in map(overview_of, self._scenes)
            ]
        return described

    def _moment(self, request: PageRequest, packer: Packer) -> dict[str, Any]:
        if request.has("time"):
            time = request.number("time", -1e12, 1e12)
        else:
            time = self._clock_of(self._leading, request.integers("pose", 1, (self._counts[self._leading],))[0])
        shown = [self._pose_at(k, time) for k in range(len(self._scenes))]
        packed = [pack_poses(scene, [pose], packer) for scene, pose in zip(self._scenes, shown, strict=True)]
        return {
            "kind": "moment",
            "poses": shown,
            "time": self._clock_of(self._leading, shown[self._leading]),
            "files": [block for block, _ in packed],
            "notes": [visible(str(refused)) for _, refused in packed if refused is not None],
        }

    def _series(self, poses: list[int], packer: Packer) -> dict[str, Any]:
        files = []
        for scene, row in zip(self._scenes, poses, strict=True):
            window = window_around(scene, row, PLOTTED_MOST)
            jump, hop = steps_in(scene, window)
            number = np.arange(window.first, window.first + len(window.time), dtype=np.float64)
            files.append(
                {
                    "clock": packer.numbers(window.time if self._by_time else number, "f8"),
                    "length": packer.numbers(window.length, "f4"),
                    "draw_frequency": packer.numbers(window.draw_frequency, "f4"),
                    "tilt": packer.numbers(np.degrees(window.tilt), "f4"),
                    "jump": packer.numbers(_counts_in(window.time, jump), "u2"),
                    "hop": packer.numbers(_counts_in(window.time, hop), "u2"),
                    "is_whole": len(window.time) == scene.pose_count,
                }
            )
        return {"kind": "series", "files": files}

    def _news(self, request: PageRequest, packer: Packer) -> dict[str, Any]:
        for scene in self._scenes:
            scene.refresh()
        limits = tuple(count + 1 for count in self._counts)
        known = request.integers("done", len(self._scenes), limits)
        is_same = known == [scene.done_count for scene in self._scenes]
        if is_same and not all(scene.is_sealed for scene in self._scenes):
            return {"kind": "same"}
        return {"kind": "news", **self._progress(packer)}

    def _pressure(self, request: PageRequest, packer: Packer) -> dict[str, Any]:
        poses = request.integers("poses", len(self._scenes), self._counts)
        where = request.choice("where", PLACES)
        moments = [scene.moment(pose) for scene, pose in zip(self._scenes, poses, strict=True)]
        prints = [self._printer.compute(moment, where) for moment in moments]
        peak = max(each.peak for each in prints)
        return {"kind": "pressure", "poses": poses, "files": [pack_prints([each], [peak], packer) for each in prints]}

    @cached_property
    def _printer(self) -> PressurePrinter:
        return PressurePrinter(self._arrays)


def _counts_in(time: np.ndarray, found: np.ndarray) -> np.ndarray:
    """How many of the found times [s] fall into each pose, shape [pose]."""
    pose = np.searchsorted(time, found, side="right") - 1
    return np.bincount(pose[pose >= 0], minlength=len(time))[: len(time)]
