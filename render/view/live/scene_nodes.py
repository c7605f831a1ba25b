"""What viser draws of a contour file: object, hand, array, contours and the focal point, each a node of its scene."""

from itertools import pairwise
from typing import Any

import numpy as np

from ....datasets.storage.schema import KIND_NAMES
from ....device.array import ArrayModel
from ...contour_batch import ContourBatch
from ...reports.picture_style import COLOURS
from ...sampling.sampler import has_contours
from ..file_scene import FileScene, Moment
from ..focal_path import FocalPath
from .guarded_server import GuardedServer

KIND_COLOURS = np.array([[int(COLOURS[kind][k : k + 2], 16) for k in (1, 3, 5)] for kind in KIND_NAMES], np.float64)
"""Of contours by kind, as in pictures."""
SKIN, PALM, SOLID, METAL = (232, 190, 172), (244, 162, 97), (141, 153, 174), (90, 96, 104)
FOCUS, JUMP, HOP = (20, 20, 20), (214, 40, 160), (247, 127, 0)
LAYERS = ("object", "hand", "skin", "contours", "focal point", "jumps", "array", "zone")
TRAIL = 60  # samples behind the focal point
FOCUS_RADIUS = 0.0025  # [m]
IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


class SceneNodes:
    """The nodes of one file. Its scene stands at `offset` [m], so that two files stand side by side."""

    def __init__(self, server: GuardedServer, scene: FileScene, root: str, offset: np.ndarray) -> None:
        self._scene, self._api, self._root = scene, server.scene, root
        self._layers: dict[str, list[Any]] = {name: [] for name in LAYERS}
        self._visible = dict.fromkeys(LAYERS, True)
        self._full: dict[str, bool] = {}
        server.scene.add_frame(root, show_axes=False, position=offset)
        self._object = self._add(
            "object",
            server.scene.add_mesh_simple,
            "object",
            vertices=scene.vertices - scene.middle.astype(np.float32),
            faces=scene.faces,
            color=SOLID,
            opacity=0.16,
            side="double",
            position=scene.middle,
        )
        self._add_hand()
        empty = np.zeros((0, 2, 3), np.float32)
        lines = server.scene.add_line_segments
        self._contours = self._add("contours", lines, "contours", empty, empty, thickness=5.0, thickness_units="screen")
        self._trail = self._add("focal point", lines, "trail", empty, empty, thickness=3.0, thickness_units="screen")
        self._focus = self._add(
            "focal point", server.scene.add_icosphere, "focus", radius=FOCUS_RADIUS, color=FOCUS, visible=False
        )
        self._jumps = self._add("jumps", lines, "jumps", empty, empty, thickness=2.0, thickness_units="screen")

    def _add(self, layer: str, make: Any, name: str, *arguments: Any, **options: Any) -> Any:
        node = make(f"{self._root}/{name}", *arguments, **options)
        self._layers[layer].append(node)
        self._full[node.name] = True
        return node

    def _add_hand(self) -> None:
        looks = self._scene.looks
        self._hand_frame = self._api.add_frame(f"{self._root}/hand", show_axes=False)
        look = looks.at(0, IDENTITY)
        mesh = {"opacity": 0.55 if look.is_rendered else 0.35, "side": "double"}
        self._hand = None
        if len(looks.faces):
            layer = "skin" if look.is_rendered else "hand"
            make = self._api.add_mesh_simple
            self._hand = self._add(
                layer, make, "hand/mesh", vertices=look.vertices, faces=looks.faces, color=SKIN, **mesh
            )
        self._patches = None
        self._patch_count = -1
        self._show_patches(look.patches)

    def _show_patches(self, patches: np.ndarray) -> None:
        if len(patches) != self._patch_count:  # a phalanx was lost or found again: another topology
            if self._patches is not None:
                self._layers["skin"].remove(self._patches)
                self._patches.remove()
            self._patch_count, self._patches = len(patches), None
            if len(patches):
                corner = 4 * np.arange(len(patches))[:, None, None]
                faces = (corner + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
                self._patches = self._add(
                    "skin",
                    self._api.add_mesh_simple,
                    "hand/patches",
                    vertices=patches.reshape(-1, 3),
                    faces=faces,
                    color=PALM,
                    opacity=0.5,
                    side="double",
                    visible=self._visible["skin"],
                )
        elif self._patches is not None:
            self._patches.vertices = patches.reshape(-1, 3)

    def set_visible(self, layer: str, visible: bool) -> None:
        """Show or hide a layer of LAYERS."""
        self._visible[layer] = visible
        for node in self._layers[layer]:
            node.visible = visible and self._full[node.name]

    def _fill(self, layer: str, node: Any, points: np.ndarray, colours: np.ndarray) -> None:
        """Show segments [m], shape [segment, 2, 3], in their colours; none hide the node."""
        self._full[node.name] = len(points) > 0
        if len(points):
            node.points, node.colors = points.astype(np.float32), colours.astype(np.uint8)
        node.visible = self._visible[layer] and len(points) > 0

    def show(self, moment: Moment) -> None:
        """Show a pose: the hand, the object if it moves, and the contours."""
        looks = self._scene.looks
        if moment.object_pose is not None:
            self._object.position, self._object.wxyz = _placed(moment.object_pose)
        if looks.is_rigid:
            self._hand_frame.position, self._hand_frame.wxyz = _placed(moment.hand_pose)
        else:
            self._show_patches(moment.hand.patches)
            if self._hand is not None:
                self._hand.vertices = moment.hand.vertices
        self._fill("contours", self._contours, *contour_segments(moment.contours))

    def show_jumps(self, contours: ContourBatch, path: FocalPath | None) -> None:
        """Show where the focal point jumps (and hops) while a pose is drawn, as lines from place to place."""
        if path is None or not has_contours(contours):
            self._fill("jumps", self._jumps, np.zeros((0, 2, 3)), np.zeros((0, 2, 3)))
            return
        place = path.position.reshape(len(path.position), -1, 3)[:, 0]
        ends = np.flatnonzero((path.jump | path.hop) & (np.arange(len(place)) > 0))
        colours = np.where(path.jump[ends, None, None], np.array(JUMP), np.array(HOP)).repeat(2, axis=1)
        self._fill("jumps", self._jumps, np.stack([place[ends - 1], place[ends]], axis=1), colours)

    def show_focus(self, path: FocalPath | None, sample: int) -> None:
        """Show the focal point at a sample of a pose's path, and its trail, which fades."""
        if path is None or not len(path.position):
            self._fill("focal point", self._trail, np.zeros((0, 2, 3)), np.zeros((0, 2, 3)))
            self._full[self._focus.name] = False
            self._focus.visible = False
            return
        place = path.position.reshape(len(path.position), -1, 3)[:, 0]
        sounds = path.intensity.reshape(len(path.intensity), -1)[:, 0] > 0
        first = max(0, sample - TRAIL)
        step = np.arange(first, sample)
        step = step[sounds[step] & sounds[step + 1] & ~path.jump[step + 1]]
        fade = 255.0 - 255.0 * ((step - first + 1) / (TRAIL + 1))[:, None, None]
        segments = np.stack([place[step], place[step + 1]], axis=1)
        self._fill("focal point", self._trail, segments, np.broadcast_to(fade, segments.shape))
        self._full[self._focus.name] = bool(sounds[sample])
        self._focus.visible = bool(sounds[sample]) and self._visible["focal point"]
        self._focus.position = place[sample]

    def add_arrays(self, arrays: list[ArrayModel]) -> None:
        """Show the transducers of arrays, and the box that each can focus in."""
        for index, array in enumerate(arrays):
            cloud = self._api.add_point_cloud
            self._add("array", cloud, f"array{index}", array.position, METAL, point_size=0.005, point_shape="circle")
            own = array.unplaced or array
            edges = box_edges(own.focal_zone.lateral, own.focal_zone.z_min, own.focal_zone.z_max)
            position, wxyz = _placed(np.asarray(array.pose))
            self._add(
                "zone",
                self._api.add_line_segments,
                f"zone{index}",
                edges,
                (170, 176, 184),
                thickness=1.0,
                thickness_units="screen",
                position=position,
                wxyz=wxyz,
            )


def contour_segments(batch: ContourBatch) -> tuple[np.ndarray, np.ndarray]:
    """Segments of contours [m], shape [segment, 2, 3], and their colours: by kind, paler where they are weaker."""
    last = batch.polyline_start[1:] - 1
    segment = np.setdiff1d(np.arange(batch.point_count), last)
    ends = np.stack([segment, segment + 1], axis=1)
    strength = np.ones(batch.point_count) if batch.intensity is None else np.asarray(batch.intensity, np.float64)
    pale = 1.0 - (0.15 + 0.85 * strength[ends])[..., None]
    colours = KIND_COLOURS[batch.kind[segment]][:, None] * (1.0 - pale) + 255.0 * pale
    return batch.points[ends], colours.round()


def box_edges(lateral: float, low: float, high: float) -> np.ndarray:
    """The 12 edges of a box over the array [m], shape [12, 2, 3]."""
    side = lateral * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    rings = [[[*a, z], [*b, z]] for z in (low, high) for a, b in pairwise(side.tolist())]
    return np.array(rings + [[[*a, low], [*a, high]] for a in side[:4].tolist()])


def _placed(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and quaternion wxyz, as viser has it, of a pose with quaternion xyzw."""
    pose = np.asarray(pose, np.float64)
    return pose[:3], pose[[6, 3, 4, 5]] / np.linalg.norm(pose[3:])
