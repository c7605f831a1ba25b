"""One scene of a picture: object, hand and contours as seen from a direction, with a scale bar and axes."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.rigid import rotate
from ..contour_batch import ContourBatch
from ..hands.hand import Hand
from ..hands.mesh_hand import MeshHand
from ..hands.stored_hand import hand_from
from .contour_lines import WIDTH, draw_contours
from .hand_silhouette import doubled_area, hand_surface, silhouette
from .picture_style import COLOURS, FAINT, INK
from .scene_view import SceneView, flat

TRIANGLES_MOST = 4000  # of a mesh that a vector picture holds as such; it holds finer ones as pixels
LIGHT = np.array([-0.35, 0.55, 0.76])  # to the light, in the view's directions
HAND_FILL, HAND_EDGE = "#f0cfae", "#b98a5e"
DARK, BRIGHT = np.array([0.66, 0.69, 0.74]), np.array([0.90, 0.92, 0.95])  # of an object
BARS = (1, 2, 5, 10, 20, 50, 100, 200, 500)  # [mm]


@dataclass(frozen=True)
class SceneSource:
    """What a contour file holds of a scene, read once."""

    file: ContourFile
    solid: dict[str, Any]
    hand: Hand
    pose: np.ndarray
    """Of the hand, shape [pose, 7]."""

    @classmethod
    def of(cls, file: ContourFile) -> "SceneSource":
        """The scene of an open file."""
        return cls(file, file.object(), hand_from(file.hand, file.hand_arrays()), file.motion()["pose"])

    def batch(self, index: int) -> ContourBatch:
        """The contours of a pose."""
        return ContourBatch.from_arrays(self.file.contours(index, index + 1))

    def triangles(self, index: int) -> np.ndarray:
        """The object's triangles at a pose [m], shape [face, 3, 3]."""
        return object_at(self.solid, index)

    def skin(self, index: int) -> np.ndarray:
        """Polygons of the skin on which contours are drawn at a pose [m], shape [polygon, corner, 3]."""
        pose = self.pose[index : index + 1]
        if isinstance(self.hand, MeshHand):
            return self.hand.triangles(pose, index)[0]
        patches = self.hand.corners(pose, index)[0]
        return patches[np.isfinite(patches).all(axis=(1, 2))]  # those that are there

    @property
    def moves(self) -> bool:
        """Whether the object moves."""
        return "moved" in self.solid


def object_at(solid: dict, pose: int) -> np.ndarray:
    """Triangles of a file's object at a pose [m], shape [face, 3, 3]."""
    vertices = solid["vertices"]
    if "moved" in solid:
        middle = np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64).mean(axis=0)
        place = solid["moved"][pose].astype(np.float64)
        vertices = place[:3] + rotate(place[3:], vertices - middle)
    return vertices[solid["faces"]]


def blank(axes: Any) -> None:
    """Axes without frame whose units are millimetres in both directions."""
    axes.set_axis_off()
    axes.set_aspect("equal", adjustable="box")


def draw_object(axes: Any, triangles: np.ndarray, basis: np.ndarray) -> list[Any]:
    """Add an object [m] as a pale, shaded body; returns the artists."""
    from matplotlib.collections import PolyCollection

    seen = flat(triangles, basis)
    front = doubled_area(seen) > 0
    depth = (triangles[front] @ basis[2]).mean(axis=1)
    order = np.argsort(depth, kind="stable")
    a, b, c = (triangles[front][order][:, k].astype(np.float64) @ basis.T for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    bright = np.clip(normal @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1)[:, None]
    colours = np.round(DARK + bright * (BRIGHT - DARK), 3)
    body = PolyCollection(list(seen[front][order]), facecolors=colours, edgecolors=colours, linewidths=0.3, zorder=1)
    body.set_rasterized(len(order) > TRIANGLES_MOST)
    axes.add_collection(body, autolim=False)
    return [body]


def draw_hand(axes: Any, source: SceneSource, index: int, basis: np.ndarray) -> list[Any]:
    """Add the hand at a pose: its outline and folds, and the rectangles that were rendered; returns the artists."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    artists: list[Any] = []
    surface = hand_surface(source.hand, source.pose[index], index)
    if surface is not None:
        hand = silhouette(*surface, basis)
        rings = [Outline(np.concatenate([ring, ring[:1]]), closed=True) for ring in hand.outline]
        shape = Outline.make_compound_path(*rings)
        fill = {"facecolor": (*_rgb(HAND_FILL), 0.45), "edgecolor": (*_rgb(HAND_EDGE), 0.9), "lw": 0.7, "zorder": 2}
        artists.append(axes.add_patch(PathPatch(shape, **fill)))
        broken = np.insert(hand.folds, 2, np.nan, axis=1).reshape(-1, 2)  # one line with gaps: small in an SVG
        look = {"color": (*_rgb(HAND_EDGE), 0.5), "lw": 0.4, "zorder": 2.1, "scalex": False, "scaley": False}
        artists += axes.plot(broken[:, 0], broken[:, 1], **look)
    if not isinstance(source.hand, MeshHand):
        skin = flat(source.skin(index), basis)
        face = (*_rgb(COLOURS["palm"]), 0.3)
        edges = {"facecolors": [face], "edgecolors": [COLOURS["palm"]], "linewidths": 0.8}
        artists.append(axes.add_collection(PolyCollection(list(skin), zorder=2.2, **edges), autolim=False))
    return artists


def draw_scene(
    axes: Any, source: SceneSource, index: int, view: SceneView, *, line_width: float = WIDTH, solid: bool = True
) -> list[Any]:
    """Draw a pose's object, unless not asked for, hand and contours; returns the artists. line_width: [pt]."""
    basis = view.basis(source.pose[index])
    blank(axes)
    artists = draw_object(axes, source.triangles(index), basis) if solid else []
    artists += draw_hand(axes, source, index, basis)
    batch = source.batch(index)
    if batch.point_count:
        return artists + draw_contours(axes, batch, lambda points: flat(points, basis), width=line_width)
    look = {"transform": axes.transAxes, "ha": "center", "va": "bottom", "color": FAINT}
    return [*artists, axes.text(0.5, 0.02, "no contour", **look)]


def extent_of(source: SceneSource, index: int, view: SceneView, *, hand: bool = True) -> np.ndarray:
    """Lowest and highest places of object and skin, and of the hand if asked, in the picture [mm], shape [2, 2]."""
    basis = view.basis(source.pose[index])
    shown = [source.triangles(index).reshape(-1, 3), source.skin(index).reshape(-1, 3)]
    surface = hand_surface(source.hand, source.pose[index], index)
    if hand and surface is not None:
        shown.append(surface[0])
    places = flat(np.concatenate(shown), basis)
    return np.stack([places.min(axis=0), places.max(axis=0)])


def set_limits(axes: Any, middle: np.ndarray, half: np.ndarray) -> None:
    """Show the places within `half` of the middle [mm]."""
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])


def draw_scale(axes: Any, basis: np.ndarray | None, *, share: float = 0.3) -> None:
    """Add a scale bar of at most this share of the scene, and the directions of x, y and z if a basis is given."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    wide, tall = right - left, high - low
    unit = min(wide, 1.1 * tall)
    length = max((bar for bar in BARS if bar <= share * unit), default=BARS[0])
    x, y = left + 0.02 * wide, low + 0.02 * tall
    axes.plot([x, x + length], [y, y], color=INK, lw=1.6, solid_capstyle="butt", zorder=5)
    axes.annotate(f"{length} mm", (x, y), (0, 2.5), textcoords="offset points", color=INK, zorder=5)
    if basis is not None:
        letter = axes.xaxis.label.get_size() / 72 * axes.figure.dpi * wide / axes.get_window_extent().width  # [mm]
        arrow = max(0.1 * unit, 1.2 * letter)
        draw_directions(axes, basis, np.array([x + arrow, y + 2.2 * letter + 0.5 * arrow]), arrow, letter)


def draw_directions(axes: Any, basis: np.ndarray, at: np.ndarray, length: float, letter: float) -> None:
    """Add arrows along x, y and z from a place [mm]; one that points at the eye or away has none.

    letter: height of a text [mm].
    """
    for name, way in zip("xyz", basis[:2].T, strict=True):
        if np.linalg.norm(way) < 0.15:
            continue
        arrow = {"arrowstyle": "-|>,head_width=0.12,head_length=0.25", "color": FAINT, "lw": 0.8}
        axes.annotate(
            "", at + length * way, at, zorder=5, arrowprops={**arrow, "shrinkA": 0, "shrinkB": 0}, annotation_clip=False
        )
        tip = at + (length + 0.55 * letter / np.linalg.norm(way)) * way
        axes.text(*tip, name, color=FAINT, ha="center", va="center", zorder=5)


def _rgb(colour: str) -> tuple[float, float, float]:
    from matplotlib.colors import to_rgb

    return to_rgb(colour)
