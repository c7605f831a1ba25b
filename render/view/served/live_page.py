"""The page of a live run: the hand that moves now, what is drawn on it, and how late it is."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np

from ...live.moment import LiveMoment, LiveScene
from ...live.moment_slot import FOCUS_MOST, FOCUS_SECONDS
from ...playback.placed_arrays import PlacedArray
from ...reports.rendering_labels import hand_text, strategy_name_of
from ..file_scene import Moment
from ..focal_path import FocalPath, steps_of
from ..packing import Packer
from ..page.payload import names_of, pack_array, pack_looks, pack_moments
from .page_server import PageRequest, Send

REACH = 0.1  # [m] around the object, in which hands move
AT_REST = np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0])


class LivePage:
    """Answers about a live run; each page that is open asks for itself, 30 times a second.

    moment: gives what is drawn now; None while nothing is.

    | a page asks | it gets |
    |---|---|
    | open | what stays the same until another object, hand or strategy is drawn |
    | now: `after`, the number of the moment that it shows | a newer moment; else only the state of the run |
    """

    slow = frozenset[str]()

    def __init__(
        self, scene: Callable[[], LiveScene], moment: Callable[[], LiveMoment | None], arrays: Sequence[PlacedArray]
    ) -> None:
        self._scene, self._moment, self._arrays = scene, moment, tuple(arrays)
        self._seen: LiveScene | None = None
        self._scene_count = 0

    def close(self) -> None:
        """Nothing: the run is the caller's."""

    def answer(self, request: PageRequest, send: Send) -> None:
        """Answer one request; raises StrategyError for a request or a value that cannot be."""
        packer = Packer(exact=True)
        if request.choice("ask", ("open", "now")) == "open":
            send(self._opened(packer), packer)
        else:
            send(self._now(int(request.number("after", -1, 2**53)), packer), packer)

    def _opened(self, packer: Packer) -> dict[str, Any]:
        scene = self._scene()
        names = names_of(scene.object_name, strategy_name_of(scene.strategy), scene.sampling)
        low, high = scene.vertices.min(axis=0) - REACH, scene.vertices.max(axis=0) + REACH
        return {
            "kind": "live",
            "title": f"{names['object']}, {names['strategy']}, live",
            "version": version("palpate"),
            "arrays": [pack_array(placed.model, packer) for placed in self._arrays],
            "bounds": [low.tolist(), high.tolist()],
            "titles": [],
            "scene": self._number_of(scene),
            "files": [
                {
                    **names,
                    "name": "live",
                    "label": names["strategy"],
                    "hand": hand_text(scene.hand.described()),
                    "pose_count": 0,
                    "has_time": True,
                    **pack_looks(
                        scene.look(AT_REST), AT_REST, scene.vertices, scene.faces, scene.hand_faces, packer,
                        is_rigid=scene.is_rigid,
                    ),
                }
            ],
        }  # fmt: skip

    def _now(self, after: int, packer: Packer) -> dict[str, Any]:
        moment = self._moment()
        if moment is None:
            return {"kind": "now", "state": "resting"}
        described: dict[str, Any] = {
            "kind": "now",
            "state": moment.state,
            "scene": self._number_of(moment.scene),
            "number": moment.number,
            "time": moment.time,
            "latency": [_finite(moment.latency.p50), _finite(moment.latency.p99)],
            "dropped": moment.dropped,
            "frames": moment.frames,
            "points_left_out": moment.points_left_out,
        }
        if moment.number > after and moment.hand is not None and moment.hand_pose is not None:
            shown = Moment(0, moment.time, moment.hand_pose, None, moment.hand, moment.contours, True)
            described["files"] = [
                pack_moments(
                    [shown],
                    np.array([shown.length]),
                    [path_of(moment)],
                    moment.scene.sampling,
                    packer,
                    is_rigid=moment.scene.is_rigid,
                )
            ]
        return described

    def _number_of(self, scene: LiveScene) -> int:
        """Another number for each scene, by which a page sees that it shows an old one."""
        if scene is not self._seen:
            self._seen = scene
            self._scene_count += 1
        return self._scene_count


def path_of(moment: LiveMoment) -> FocalPath | None:
    """The newest focal points of a live run; None where there are none."""
    focus, sampling = moment.focus, moment.scene.sampling
    if not len(focus.intensity):
        return None
    foci = focus.intensity[0].size
    rate = sampling.update_rate / np.ceil(FOCUS_SECONDS * sampling.update_rate / (FOCUS_MOST // foci))  # thinned
    jump, hop = steps_of(focus.position, focus.intensity, replace(sampling, update_rate=rate))
    return FocalPath(focus.position, focus.intensity, rate, jump, hop)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
