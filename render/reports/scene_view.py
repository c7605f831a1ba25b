"""Where a scene is seen from: a named view, or elevation and azimuth. Rays are parallel: lengths can be measured."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...datasets.known_names import find_name, likely_name
from ..errors import StrategyError
from ..hands.hand import Palm
from ..validation import value_text

NAMED = {
    "iso": (22.0, -60.0),
    "front": (0.0, -90.0),
    "back": (0.0, 90.0),
    "side": (0.0, 0.0),
    "top": (90.0, -90.0),
}
"""Elevation over the array's plane and azimuth from its x axis [degree], of the eye."""
PALM = "palm"
FORMS = f"{', '.join((*NAMED, PALM))}, or ELEVATION,AZIMUTH in degrees, as 30,-45"


@dataclass(frozen=True)
class SceneView:
    """A direction to look from, or the palm's own, from the back of the hand with the fingers up."""

    elevation: float
    """[degree]"""
    azimuth: float
    """[degree]"""
    follows_palm: bool = False

    @classmethod
    def of(cls, view: "str | Sequence[float] | SceneView") -> "SceneView":
        """A view by name, as text, or by its angles [degree]; raises StrategyError for another one."""
        if isinstance(view, SceneView):
            return view
        if isinstance(view, str):
            name = find_name(view, (*NAMED, PALM))
            if name == PALM:
                return cls(*NAMED["iso"], follows_palm=True)
            if name is not None:
                return cls(*NAMED[name])
        try:
            elevation, azimuth = (float(angle) for angle in (view.split(",") if isinstance(view, str) else view))
        except (TypeError, ValueError):
            raise StrategyError(
                f"unknown view {value_text(view)}{likely_name(view, (*NAMED, PALM))}; known: {FORMS}"
            ) from None
        if not (abs(elevation) <= 90.0 and math.isfinite(azimuth)):  # a NaN compares false
            raise StrategyError(f"a view's elevation must lie between -90 and 90 degrees, not {elevation:g}")
        return cls(elevation, azimuth)

    def basis(self, pose: np.ndarray | None = None) -> np.ndarray:
        """Directions to the right, up, and to the eye, array frame, shape [3, 3]; of a pose where it follows the palm.

        pose: of the hand, float, shape [7].
        """
        if self.follows_palm and pose is not None:
            frames = Palm().frames(np.asarray(pose)[None])
            return np.stack([frames.u[0, 0], frames.v[0, 0], frames.n[0, 0]])
        azimuth, elevation = np.radians([self.azimuth, self.elevation])
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        eye = np.cos(elevation) * level + np.sin(elevation) * np.array([0.0, 0.0, 1.0])
        return np.stack([right, np.cross(eye, right), eye])

    def facing(self, normal: np.ndarray) -> np.ndarray:
        """How squarely planes with these normals, shape [n, 3], are seen: 1 from the front, 0 edge on."""
        if self.follows_palm:
            return np.ones(len(normal))
        return np.abs(normal @ self.basis()[2])


def flat(points: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Points [m], shape [..., 3], in the picture's plane [mm], shape [..., 2]."""
    return 1e3 * (np.asarray(points, np.float64) @ basis[:2].T)
