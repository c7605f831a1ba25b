"""One scene of a picture: object, hand and contours as seen from a direction, and the setting that they stand in.

Rays are parallel, so lengths can be measured in a picture.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.known_names import find_name, likely_name
from ...datasets.rigid import rotate
from ...datasets.storage.schema import KIND_NAMES
from ...device.array import ArrayModel
from ..contour_batch import HAND, ContourBatch
from ..errors import StrategyError
from ..hands.hand import Hand, Palm
from ..hands.mesh_hand import MeshHand
from ..hands.stored_hand import hand_around, hand_from
from ..stages.curves import divide_batch
from ..validation import value_text
from .picture_style import COLOURS, FAINT, HAND_DASHES, INK, paler

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


DETAIL = 2  # of palpate's own hand: 5,248 triangles; its outline takes 30 ms
SMALLEST = 1e-6  # [mm²] of a triangle that is seen; smaller ones are edge on


class Silhouette(NamedTuple):
    """A hand as it is seen."""

    outline: list[np.ndarray]
    """Closed outlines [mm], each of shape [point, 2]; holes run the other way round."""
    folds: np.ndarray
    """Edges between a triangle that faces the eye and one that does not [mm], shape [edge, 2, 2]."""


def hand_surface(hand: Hand, pose: np.ndarray, row: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Vertices [m], array frame, and faces of a hand at a pose, shape [7]; None for a hand of several planes.

    A palm gets palpate's own right hand, as broad as the palm is wide. row: of the motion.
    """
    if isinstance(hand, MeshHand):
        vertices, faces = hand.vertices[0 if hand.pose_count is None else row], hand.faces
    elif isinstance(hand, Palm):
        shape = hand_around(round(hand.width, 4), DETAIL)
        vertices, faces = shape.vertices, shape.faces
    else:
        return None
    pose = np.asarray(pose, np.float64)
    return pose[:3] + rotate(pose[3:], np.asarray(vertices, np.float64)), faces


def silhouette(vertices: np.ndarray, faces: np.ndarray, basis: np.ndarray) -> Silhouette:
    """Outline and folds of a surface [m] in a view's plane."""
    from manifold3d import CrossSection, FillRule

    seen = flat(vertices, basis)[faces]
    area = doubled_area(seen)
    facing = area > 0
    wound = np.where(facing[:, None, None], seen, seen[:, ::-1])
    filled = CrossSection(list(wound[np.abs(area) > SMALLEST]), FillRule.Positive).simplify(0.05)
    return Silhouette([np.asarray(loop) for loop in filled.to_polygons()], _folds(vertices, faces, facing, basis))


def doubled_area(triangles: np.ndarray) -> np.ndarray:
    """Twice the signed area of flat triangles, shape [triangle, 3, 2]: above 0 where they face the eye."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _folds(vertices: np.ndarray, faces: np.ndarray, facing: np.ndarray, basis: np.ndarray) -> np.ndarray:
    edges = np.sort(np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    front = np.tile(facing, 3)
    order = np.lexsort(edges.T)
    edges, front = edges[order], front[order]
    same = (edges[1:] == edges[:-1]).all(axis=1) & (front[1:] != front[:-1])
    return flat(vertices, basis)[edges[1:][same]]


FINE = 1e-3  # [m] of the pieces by which varying intensity is shown
WIDTH = 2.2  # [pt]
HALO = 1.0  # [pt] of white beside lines, which sets them off from what is below
LEVELS = 20  # of intensity that are shown: neighbours of one level are one line


def draw_contours(axes: Any, batch: ContourBatch, place: Any, *, width: float = WIDTH) -> list[Any]:
    """Add the contours of a batch of one pose to axes, whose limits are set; returns the artists.

    place: function of points [m], shape [point, 3], that gives them in the picture, shape [point, 2]. width: [pt].
    """
    from matplotlib.collections import LineCollection

    lines, kind, strength = intensity_runs(batch)
    shown = [place(line) for line in lines]
    colours = [paler(COLOURS[KIND_NAMES[k]], s) for k, s in zip(kind, strength, strict=True)]
    # Dashes go on from line to line, as one contour is many lines where its intensity varies. Units: widths of a line.
    unit = axes.get_window_extent().width / axes.figure.dpi * 72 / abs(np.subtract(*axes.get_xlim())) / width
    length = [unit * np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in shown]
    offset = np.concatenate([[0.0], np.where(kind == HAND, length, 0.0).cumsum()]) % sum(HAND_DASHES)
    dashes = [(float(at), HAND_DASHES) if k == HAND else "-" for at, k in zip(offset, kind, strict=False)]
    ends = {"capstyle": "round", "joinstyle": "round"}
    artists: list[Any] = [
        LineCollection(shown, colors=[("white", 0.7)], linewidths=width + HALO, zorder=2.9, **ends),
        LineCollection(shown, colors=colours, linewidths=width, linestyles=dashes, zorder=3.0, **ends),
    ]
    for artist in artists:
        axes.add_collection(artist, autolim=False)
    if batch.dwell is not None and (batch.dwell > 0).any():
        at = place(batch.points[batch.dwell > 0])
        look = {"ms": 4.5, "color": INK, "mec": "white", "mew": 0.6, "zorder": 3.2}
        artists += axes.plot(at[:, 0], at[:, 1], "o", **look)
    return artists


def varies(batch: ContourBatch) -> bool:
    """Whether any part of the contours is weaker than full intensity."""
    return batch.intensity is not None and batch.point_count > 0 and float(batch.intensity.min()) < 1.0


def intensity_runs(batch: ContourBatch) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Lines [m] of one kind and one intensity each, their kinds, and their intensities; finely cut where it varies."""
    fine = divide_batch(batch, FINE) if varies(batch) else batch
    count = fine.point_count
    last = np.zeros(count, bool)
    last[fine.polyline_start[1:] - 1] = True
    segment = np.flatnonzero(~last)
    points = np.ones(count) if fine.intensity is None else np.asarray(fine.intensity, np.float64)
    strength = 0.5 * (points[segment] + points[np.minimum(segment + 1, count - 1)])
    strength = np.round(strength * LEVELS) / LEVELS
    kind = fine.kind[segment]
    goes_on = (np.diff(segment) == 1) & (np.diff(kind) == 0) & (np.diff(strength) == 0)
    first = np.concatenate([[True], ~goes_on])[: len(segment)]
    start = np.flatnonzero(first)
    stop = np.append(start[1:], len(segment))
    lines = [fine.points[segment[a] : segment[b - 1] + 2] for a, b in zip(start, stop, strict=True)]
    return lines, kind[start], strength[start]


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


def draw_object(axes: Any, triangles: np.ndarray, basis: np.ndarray) -> None:
    """Add an object [m] as a pale, shaded body."""
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


def draw_hand(axes: Any, source: SceneSource, index: int, basis: np.ndarray) -> None:
    """Add the hand at a pose: its outline and folds, and the rectangles that were rendered."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    surface = hand_surface(source.hand, source.pose[index], index)
    if surface is not None:
        hand = silhouette(*surface, basis)
        rings = [Outline(np.concatenate([ring, ring[:1]]), closed=True) for ring in hand.outline]
        shape = Outline.make_compound_path(*rings)
        fill = {"facecolor": (*_rgb(HAND_FILL), 0.45), "edgecolor": (*_rgb(HAND_EDGE), 0.9), "lw": 0.7, "zorder": 2}
        axes.add_patch(PathPatch(shape, **fill))
        broken = np.insert(hand.folds, 2, np.nan, axis=1).reshape(-1, 2)  # one line with gaps: small in an SVG
        look = {"color": (*_rgb(HAND_EDGE), 0.5), "lw": 0.4, "zorder": 2.1, "scalex": False, "scaley": False}
        axes.plot(broken[:, 0], broken[:, 1], **look)
    if not isinstance(source.hand, MeshHand):
        skin = flat(source.skin(index), basis)
        face = (*_rgb(COLOURS["palm"]), 0.3)
        edges = {"facecolors": [face], "edgecolors": [COLOURS["palm"]], "linewidths": 0.8}
        axes.add_collection(PolyCollection(list(skin), zorder=2.2, **edges), autolim=False)


def draw_scene(axes: Any, source: SceneSource, index: int, view: SceneView, *, line_width: float) -> None:
    """Draw a pose's object, hand and contours. line_width: [pt]."""
    basis = view.basis(source.pose[index])
    blank(axes)
    draw_object(axes, source.triangles(index), basis)
    draw_hand(axes, source, index, basis)
    batch = source.batch(index)
    if batch.point_count:
        draw_contours(axes, batch, lambda points: flat(points, basis), width=line_width)
        return
    look = {"transform": axes.transAxes, "ha": "center", "va": "bottom", "color": FAINT}
    axes.text(0.5, 0.02, "no contour", **look)


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


FACE, RIM, DISC = "#eef1f5", "#5b6470", "#a3afbd"
FAR = 0.8  # [m] from the array's middle to the object's; farther arrays are left out
WAY_MOST = 2000  # poses of the palm's way that are drawn
CIRCLE = np.linspace(0, 2 * np.pi, 13)[:-1]
FOOT = 0.12  # of the height, below, for the scale bar
GAP = 0.46  # radius of a drawn transducer as a share of the distance to the nearest one


def is_near(model: ArrayModel, source: SceneSource) -> bool:
    """Whether an array and the object fit into one picture."""
    middle = source.triangles(0).reshape(-1, 3)
    middle = 0.5 * (middle.min(axis=0) + middle.max(axis=0))
    return float(np.linalg.norm(model.position.mean(axis=0) - middle)) <= FAR


def draw_overview(
    axes: Any,
    source: SceneSource,
    poses: np.ndarray,
    view: SceneView,
    models: Sequence[ArrayModel],
) -> None:
    """Draw arrays, the object at the first pose shown, the palm's way, and where it is at the poses shown."""
    box, font = axes.get_window_extent(), axes.xaxis.label.get_size()
    aspect = box.width / box.height
    blank(axes)
    basis = SceneView(view.elevation, view.azimuth).basis()
    places = [flat(source.triangles(int(poses[0])).reshape(-1, 3), basis)]
    for model in models:
        places.append(_draw_array(axes, model, basis))
    draw_object(axes, source.triangles(int(poses[0])), basis)
    step = max(1, len(source.pose) // WAY_MOST)
    way = flat(source.pose[::step, :3], basis)
    if len(source.pose) > 1:
        axes.plot(way[:, 0], way[:, 1], color=FAINT, lw=0.5, alpha=0.7, zorder=2)
    marks = flat(source.pose[poses, :3], basis)
    axes.plot(marks[:, 0], marks[:, 1], "o", ms=1.4 * font, mfc="white", mec=INK, mew=0.7, zorder=4)
    for k, mark in enumerate(marks):
        axes.annotate(letter(k), mark, ha="center", va="center_baseline", zorder=5)
    places += [way, marks]
    low, high = (getattr(np.concatenate(places), end)(axis=0) for end in ("min", "max"))
    low = low - FOOT * (high - low) * [0.0, 1.0]
    half = 0.52 * (high - low) + 6
    set_limits(axes, 0.5 * (low + high), np.array([max(half[0], half[1] * aspect), max(half[1], half[0] / aspect)]))


def _draw_array(axes: Any, model: ArrayModel, basis: np.ndarray) -> np.ndarray:
    """Add an array: its face and its transducers as discs; returns places [mm] that it takes."""
    from matplotlib.collections import PolyCollection

    position = model.position.astype(np.float64)
    nearest = np.linalg.norm(position[1:] - position[0], axis=1).min() if len(position) > 1 else 0.01
    across, along = rotate(np.asarray(model.pose, np.float64)[3:], np.eye(3)[:2])
    ring = GAP * nearest * (np.cos(CIRCLE)[:, None] * across + np.sin(CIRCLE)[:, None] * along)
    discs = flat(position[:, None] + ring, basis)
    local = (position - position.mean(axis=0)) @ np.stack([across, along]).T
    half = np.abs(local).max(axis=0) + 0.5 * nearest
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    face = flat(position.mean(axis=0) + corners @ np.stack([across, along]), basis)
    look = {"linewidths": 0.5, "edgecolors": [RIM]}
    axes.add_collection(PolyCollection([face], facecolors=[FACE], zorder=0.1, **look), autolim=False)
    axes.add_collection(
        PolyCollection(list(discs), facecolors=[DISC], zorder=0.2, linewidths=0),
        autolim=False,
    )
    return face


def letter(k: int) -> str:
    """The name of a moment: a, b, c ..."""
    return chr(ord("a") + k)
