"""MeshObject: a mesh from a file, from arrays or built in, placed in the array's frame and repaired."""

import hashlib
import warnings
from copy import copy
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from threading import RLock
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
import warp as wp

from ....datasets.errors import name_nothing
from ....datasets.known_names import likely_file, likely_name
from ....datasets.shapes.built_in import shape, shape_name, shape_names
from ....kernels.fields.field import Field
from ....kernels.fields.mesh_inside import mesh_field
from ....kernels.section.half_edges import HalfEdges, upload_surface
from ...errors import MeshError, PalpateWarning, PlacementError, RepairError
from ...runtime.interrupt import interrupt_between
from ...runtime.loading_progress import Watch, unwatched
from ...validation import unit_hint
from .cache import cache_folder, repaired_mesh
from .repair import Repair
from .report import MeshReport

SIZE_LARGEST = 5.0  # [m]; a larger object does not fit any workspace: its file is probably in millimetres
_EDGES: WeakValueDictionary[str, HalfEdges] = WeakValueDictionary()  # by `MeshObject.identity`
POOL_KEPT = 0.5  # share of a GPU's memory kept for the next batch, because freeing it at every wait takes milliseconds
TRIANGLES_ANNOUNCED = 2_000_000  # a warning gives the expected time before repairing at least as many
REPAIR_SECONDS, REPAIR_GIGABYTES = 8.0, 0.6  # for a million triangles; measured, docs/measured/performance.md
SOLID_RULES = ("winding", "even-odd")
UP_AXES = ("x", "y", "z", "-x", "-y", "-z")


@dataclass(frozen=True)
class Placement:
    """Transform from a file's coordinates to the array's: scale, `up`, fit, rotate and move, in this order."""

    scale: float = 1.0
    """Factor on all coordinates (0.001 for a file in millimetres)."""
    up: str = "z"
    """Axis of the file that points up, away from the array: one of x, y, z, -x, -y, -z."""
    fit: float | None = None
    """Longest side of the bounding box [m]; None leaves the size alone."""
    rotate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Angles about the array's x, then y, then z axis, through the middle of the bounding box [degree]."""
    at: tuple[float, float, float] | None = None
    """Where the middle of the bounding box goes [m], array frame; None leaves it where it is."""

    def __post_init__(self) -> None:
        """Raise PlacementError for a value that is not allowed."""
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise PlacementError(f"scale must be positive, not {self.scale}")
        if self.up not in UP_AXES:
            raise PlacementError(f"up must be one of {', '.join(UP_AXES)}, not {self.up!r}")
        if self.fit is not None and not (np.isfinite(self.fit) and self.fit > 0):
            raise PlacementError(f"fit must be a positive length in metres, not {self.fit}")
        for field, value in (("rotate", self.rotate), ("at", self.at)):
            if value is not None and (len(value) != 3 or not np.isfinite(value).all()):
                raise PlacementError(f"{field} must be three finite numbers, not {value}")

    def applied_to(self, vertices: np.ndarray) -> np.ndarray:
        """Placed vertices [m], shape [vertex, 3]."""
        if self == Placement():
            return vertices
        out = vertices * self.scale @ up_rotation(self.up).T
        middle = (out.min(axis=0) + out.max(axis=0)) / 2
        out = out - middle
        if self.fit is not None:
            out *= self.fit / np.ptp(out, axis=0).max()
        for axis, angle in enumerate(self.rotate):
            out = out @ axis_rotation(axis, np.radians(angle)).T
        return out + (middle if self.at is None else np.asarray(self.at))

    def factor_of(self, vertices: np.ndarray) -> float:
        """Factor by which lengths grow."""
        if self.fit is None:
            return self.scale
        finite = vertices[np.isfinite(vertices).all(axis=-1)] if vertices.ndim == 2 else vertices[:0]
        if len(finite) == 0:
            return self.scale
        return self.fit / (float(np.ptp(finite, axis=0).max()) or 1.0)


def warn_of_place(name: str, bounds: np.ndarray, way: str) -> None:
    """Warn (PalpateWarning) of an object that is too large or reaches behind the array.

    bounds: [m], array frame, shape [2, 3]; way: advice against the size. Call it from a method that a constructor
    calls: the warning is attributed to the constructor's caller.
    """
    size, low, high = np.ptp(bounds, axis=0), bounds[0, 2], bounds[1, 2]
    if size.max() > SIZE_LARGEST:
        fault = f"is {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} m; {way}"
    elif low < 0:
        fault = (
            f"reaches behind the array (z from {low:.4g} to {high:.4g} m): coordinates are taken as they are, "
            "at=(0, 0, 0.2) places it in front"
        )
    else:
        return
    warnings.warn(f"{name}: {fault}", PalpateWarning, stacklevel=4)


def axis_rotation(axis: int, angle: float) -> np.ndarray:
    """Rotation matrix about a coordinate axis [rad]; quarter turns are exact."""
    c, s = np.cos(angle), np.sin(angle)
    c, s = (np.round(c), np.round(s)) if abs(np.sin(2 * angle)) < 1e-15 else (c, s)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out


def up_rotation(up: str) -> np.ndarray:
    """Rotation that brings an axis of the file to +z: a turn about the file's x (for x itself, about its y)."""
    axis, angle = {"z": (0, 0), "y": (0, 1), "-z": (0, 2), "-y": (0, -1), "x": (1, -1), "-x": (1, 1)}[up]
    return axis_rotation(axis, angle * np.pi / 2)


def require_solid_rule(solid: str) -> str:
    """Return the rule for what is inside; raises RepairError unless it is one of SOLID_RULES."""
    if solid not in SOLID_RULES:
        raise RepairError(f"solid must be one of {', '.join(SOLID_RULES)}, not {solid!r}")
    return solid


def repeats_at_most(points: np.ndarray) -> int:
    """Upper bound on the number of float32 points that repeat an earlier one, from equal hashes.

    It is 20 times as fast as sorting the points; an exact count is needed only if this bound is large.
    """
    mixed = np.zeros(len(points), np.uint64)
    for column in np.ascontiguousarray(points.T).view(np.uint32):
        mixed = (mixed ^ column) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    mixed.sort()
    return int(np.count_nonzero(mixed[1:] == mixed[:-1]))


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """All triangles of a file that trimesh reads, a scene flattened with its transforms.

    Raises MeshError for a missing file, one that cannot be read, and one without triangles.
    """
    with interrupt_between() as interrupted:
        import trimesh  # takes half a second, which built-in objects save; it swallows Ctrl-C meanwhile

        from .files import load_scene, mesh_arrays

        interrupted()
    if not path.exists():
        meant = likely_name(path, shape_names()) or likely_file(path)
        raise name_nothing(MeshError(f"{path}: no such file{meant}; built-in objects are {', '.join(shape_names())}"))
    scene = load_scene(path)
    try:
        nodes = scene.graph.nodes_geometry
        transform, name = scene.graph[nodes[0]] if len(nodes) == 1 else (None, None)
        mesh = scene.geometry.get(name)
        if not isinstance(mesh, trimesh.Trimesh) or not np.array_equal(transform, np.eye(4)):
            mesh = scene.to_mesh() if scene.geometry else trimesh.Trimesh()  # slow: hashes all ten times
        vertices, faces = mesh_arrays(mesh)
    except Exception as error:  # each format's reader raises its own errors
        raise MeshError(f"{path}: cannot be read as a mesh ({type(error).__name__}: {error})") from error
    if len(faces) == 0:
        raise MeshError(f"{path}: has no triangles ({path.stat().st_size} bytes)")
    return vertices, faces


class MeshObject:
    """A triangle mesh in the array's frame, checked and repaired.

    vertices: [m], shape [vertex, 3]; faces: int, shape [face, 3], counter-clockwise from outside.
    solid: what is inside: "winding", where the winding number of all bodies is above 0, or "even-odd", where it is odd.
    weld: vertices at most this far apart are merged [m]; fill_holes: holes whose rim is at most this long are closed
    [m]; both lengths in the placed object. watch: called with each stage of loading.
    Warns (PalpateWarning) of faults found or repaired, of a size that suggests millimetres, and of an object behind
    the array.
    Raises MeshError for arrays that are no mesh, RepairError for an option with a value that is not allowed.
    """

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        *,
        name: str = "mesh",
        placement: Placement | None = None,
        solid: str = "winding",
        weld: float = 0.0,
        fill_holes: float = 0.0,
        watch: Watch = unwatched,
    ) -> None:
        self.name = name
        self.solid = require_solid_rule(solid)
        """What counts as inside: "winding" (winding number > 0) or "even-odd" (an odd winding number)."""
        self.placement = placement or Placement()
        vertices, faces = np.asarray(vertices), np.asarray(faces)
        self._scale = self.placement.factor_of(vertices)
        repaired = repaired_mesh(vertices, faces, self._repair(weld, fill_holes), watch, announce=self._announce)
        self.report = repaired.report
        """Faults found and repairs made; lengths in the unit of the vertices as given."""
        self._solid_count = repaired.solid_count
        self._repair_options = {"solid": self.solid, "weld": weld, "fill_holes": fill_holes}
        self.vertices = self.placement.applied_to(repaired.vertices).astype(np.float32)
        """[m], float32, shape [vertex, 3]."""
        self.faces = repaired.faces.astype(np.int32)
        """int32, shape [face, 3]; first the faces that bound the solid, then those of open surfaces."""
        self._on: dict[str, Any] = {}  # by device: a Surface, a Warp struct that type checkers do not know
        self._fields: dict[str, Field] = {}
        self.detail: dict[str, Any] | None = None
        """Result of `simplify`; None if the mesh was not simplified."""
        self._lock = RLock()
        self._warn_of_report()
        self._check_size()
        self._check_rounding(repaired.vertices)

    @classmethod
    def load(
        cls,
        source: str | Path,
        *,
        placement: Placement | None = None,
        solid: str = "winding",
        weld: float = 0.0,
        fill_holes: float = 0.0,
        watch: Watch = unwatched,
    ) -> "MeshObject":
        """Load a built-in object by name, or any mesh file that trimesh reads (STL, OBJ, PLY, GLB, ...).

        Other arguments and errors as for the class.
        """
        options = {"placement": placement, "solid": solid, "weld": weld, "fill_holes": fill_holes, "watch": watch}
        if (name := shape_name(source)) is not None:
            return cls(*shape(name), name=name, **options)
        path = Path(source)
        watch("reading", 0, 1)
        vertices, faces = read_mesh(path)
        try:
            return cls(vertices, faces, name=path.name, **options)
        except MeshError as error:
            raise MeshError(f"{path}: {error}") from error

    def _repair(self, weld: float, fill_holes: float) -> Repair:
        for field, value in (("weld", weld), ("fill_holes", fill_holes)):
            if not 0 <= value < np.inf:  # a NaN compares false
                raise RepairError(f"{field} must be a length in metres of 0 or more, not {value}")
            if value > SIZE_LARGEST:
                hint = unit_hint(value, 0.0, SIZE_LARGEST, "m")
                raise RepairError(f"{field} must be {SIZE_LARGEST:g} m at most, not {value}{hint}")
        return Repair(self.solid, weld / self._scale, fill_holes / self._scale)

    def _announce(self, triangle_count: int) -> None:
        if triangle_count >= TRIANGLES_ANNOUNCED:
            millions = triangle_count / 1e6
            once = "" if cache_folder() is None else "; the result is kept on disk"
            warnings.warn(
                f"{self.name}: {millions:.3g} million triangles take about {millions * REPAIR_SECONDS:.0f} s and "
                f"{millions * REPAIR_GIGABYTES:.1f} GB of memory to check and repair{once}",
                PalpateWarning,
                stacklevel=4,
            )

    def _warn_of_report(self) -> None:
        phrases = self.report.changes() + self.report.faults(self._scale)
        if phrases:
            warnings.warn(f"{self.name}: " + "; ".join(phrases), PalpateWarning, stacklevel=3)

    def _check_size(self) -> None:
        if not np.isfinite(self.vertices).all():
            raise MeshError(f"{self.name}: coordinates overflow after placement (scale {self.placement.scale})")
        fit = self.placement.fit
        way = "like a file in millimetres: use scale=0.001, or fit=0.13"
        if fit is not None:
            way = f"lengths are in metres, {fit:g} mm are fit={fit / 1000:g}"
        warn_of_place(self.name, self.bounds, way)
        if self.placement.at is not None and np.abs(self.placement.at).max() > SIZE_LARGEST:
            metres = ", ".join(f"{value / 1000:g}" for value in self.placement.at)
            fault = f"lies at {self.placement.at} m; lengths are in metres, in millimetres that were at=({metres})"
            warnings.warn(f"{self.name}: {fault}", PalpateWarning, stacklevel=3)

    def _check_rounding(self, vertices: np.ndarray) -> None:
        allowed = len(vertices) // 100
        placed = self.vertices + np.float32(0)  # -0 is 0
        if repeats_at_most(placed) <= allowed:
            return
        lost = len(vertices) - len(np.unique(placed, axis=0))
        if lost > allowed:
            warnings.warn(
                f"{self.name}: {lost} of {len(vertices)} vertices fall on others in float32, which steps by "
                f"{np.spacing(np.abs(self.vertices).max()):.2g} m this far from the array: at=(0, 0, 0.2) is nearer",
                PalpateWarning,
                stacklevel=3,
            )

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest coordinates [m], shape [2, 3]."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)]).astype(np.float64)

    @cached_property
    def edges(self) -> HalfEdges:
        """Half-edges, in the order by which contours are numbered; shared by objects with the same placed mesh."""
        edges = _EDGES.get(self.identity)
        if edges is None:
            edges = _EDGES[self.identity] = HalfEdges(self.vertices, self.faces)
        return edges

    @cached_property
    def identity(self) -> str:
        """SHA-256 over placed vertices and faces, and over the rule `solid` unless it is "winding"."""
        rule = b"" if self.solid == SOLID_RULES[0] else b"/" + self.solid.encode()
        return hashlib.sha256(self.vertices.tobytes() + b"/" + self.faces.tobytes() + rule).hexdigest()

    def require_closed(self) -> None:
        """Raise MeshError, with the counts and the ways out, unless inside and outside are defined."""
        report = self.report
        if report.closed:
            return
        if report.crossed_edges:
            fault = f"it has one side only ({report.crossed_edges} edges where no orientation agrees)"
        else:
            fault = f"it has {report.open_edges} open edges ({report.bodies} bodies)"
        raise MeshError(
            f"{self.name}: closed contours (CC), hand meshes and contact need a closed surface, but {fault}. "
            f'Ways out: palpate voxelise {self.name} makes a closed solid of it, strategy="oc" accepts any mesh on '
            "palms, or close the mesh in a mesh editor"
        )

    @cached_property
    def solid_part(self) -> "MeshObject":
        """The object without open surfaces, which enclose nothing: closed contours are made of this part."""
        if self.report.sheet_faces == 0:
            return self
        report = replace(self.report, sheet_faces=0, open_edges=0, holes=0, rim_longest=0.0)
        return self._of_faces(self.faces[: self._solid_count], report)

    @cached_property
    def sheet_part(self) -> "MeshObject":
        """The open surfaces alone; their contours stay as they are cut."""
        return self._of_faces(self.faces[self._solid_count :], replace(self.report, crossings=0, sheet_faces=0))

    def _of_faces(self, faces: np.ndarray, report: MeshReport) -> "MeshObject":
        out = copy(self)
        for name in ("edges", "identity", "solid_part", "sheet_part"):
            out.__dict__.pop(name, None)
        out.faces, out.report, out._on, out._fields, out._lock = faces, report, {}, {}, RLock()
        return out

    @property
    def is_simple(self) -> bool:
        """Whether no triangles cross or overlap, so that the section by any plane is bounded by its contours as cut."""
        return self.report.crossings == 0

    def on(self, device: str) -> Any:
        """The mesh on a Warp device, a Surface, uploaded once."""
        if device not in self._on:
            if wp.get_device(device).is_cuda:
                wp.set_mempool_release_threshold(device, POOL_KEPT)
            self._on[device] = upload_surface(self.edges, device)
        return self._on[device]

    def field_on(self, device: str) -> Field:
        """The inside of a closed mesh as a field on a Warp device, made once."""
        with self._lock:
            if device not in self._fields:
                self._fields[device] = mesh_field(self.on(device), self.bounds, solid=self.solid)
            return self._fields[device]

    def outline_mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """The mesh itself."""
        return self.vertices, self.faces

    def described(self) -> dict:
        """Description of the object that a file stores as JSON."""
        return {
            "name": self.name,
            "triangles": len(self.faces),
            "hash": self.identity,
            "placement": asdict(self.placement),
            "repair": self._repair_options,
            "report": asdict(self.report),
            **({} if self.detail is None else {"detail": self.detail}),
        }
