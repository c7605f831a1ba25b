"""MeshObject: a mesh from a file, from arrays or built in, placed in the array's frame, repaired and described."""

import hashlib
import warnings
from copy import copy
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack
from weakref import WeakValueDictionary

import numpy as np
import warp as wp

from ....datasets.errors import name_nothing
from ....datasets.known_names import likely_file, likely_name
from ....datasets.shapes.built_in import shape, shape_name, shape_names
from ....kernels.fields.field import Field
from ....kernels.fields.mesh_inside import mesh_field
from ....kernels.section.half_edges import HalfEdges, upload_surface
from ...device_copies import KeepsDeviceCopies
from ...errors import MeshError, PalpateWarning, RepairError
from ...file_kinds import MESH_SUFFIXES
from ...runtime.loading_progress import Watch, unwatched
from ...user_warnings import warn_user
from ...validation import unit_hint
from .cache import edges_of_mesh, repaired_mesh
from .files import foreign_arrays, load_mesh, pyvista_mesh, trimesh_mesh
from .placement import SIZE_LARGEST, Placement, PlacementFields, place_text, placement_of, warn_of_place
from .repair import Repair
from .report import MeshReport

if TYPE_CHECKING:
    import pyvista
    import trimesh

_EDGES: WeakValueDictionary[str, HalfEdges] = WeakValueDictionary()  # by `MeshObject.identity`
POOL_KEPT = 0.5  # share of a GPU's memory kept for the next batch, because freeing it at every wait takes milliseconds
VOXELS_ACROSS = 100  # of a mesh, in the command that an error suggests
SOLID_RULES = ("winding", "even-odd")
FLAT = 1e-4  # planes whose normals, or whose places in units of the mesh's size, differ by less may be one plane
ROUNDINGS = 8.0  # of float32: what two faces on each other may be apart by, seen along a plane that cuts both askew
GAP_LARGEST = 1e-6  # [m]; a tenth of what contours are right to
GLTF_SUFFIXES = (".gltf", ".glb")


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
    """All triangles of a mesh file, a scene flattened with its transforms: vertices and faces, see `FileMesh`.

    Raises MeshError for a missing file, one that cannot be read, and one without triangles.
    """
    if not path.exists():
        meant = likely_name(str(path), shape_names()) or likely_file(path)
        raise name_nothing(MeshError(f"{path}: no such file{meant}; built-in objects are {', '.join(shape_names())}"))
    mesh = load_mesh(path)
    return mesh.vertices, mesh.faces


def _has_opposite_planes(vertices: np.ndarray, faces: np.ndarray) -> bool:
    from scipy.spatial import KDTree  # a tenth of a second that simple meshes do without

    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corner = ((vertices - 0.5 * (low + high)) / np.ptp([low, high], axis=0).max())[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(normal, axis=1)
    normal, corner = normal[length > 0] / length[length > 0, None], corner[length > 0]
    place = np.einsum("ij,ij->i", normal, corner[:, 0])
    plane = np.unique(np.rint(np.column_stack([normal, place]) / FLAT), axis=0)  # many faces of a voxel mesh share one
    distance = np.asarray(KDTree(plane).query(-plane, distance_upper_bound=4.0)[0])  # rounding: 2 units a coordinate
    return bool(np.isfinite(distance).any())


class MeshObject(KeepsDeviceCopies):
    """A triangle mesh in the array's frame, checked and repaired.

    vertices: [m], shape [vertex, 3]; faces: int, shape [face, 3], counter-clockwise from outside. Or a mesh of trimesh
    or PyVista instead of both.
    placement, or its fields `scale`, `up`, `fit`, `rotate`, `at`: where the mesh goes.
    solid: what is inside: "winding", where the winding number of all bodies is above 0, or "even-odd", where it is odd.
    weld: vertices at most this far apart are merged [m]; fill_holes: holes whose rim is at most this long are closed
    [m]; both lengths in the placed object. watch: called with each stage of loading.
    Warns (PalpateWarning) of faults found or repaired, of a size that suggests millimetres, and of an object behind
    the array.
    Raises MeshError for arrays that are no mesh, RepairError for an option with a value that is not allowed.

    >>> import trimesh
    >>> from palpate.render import MeshObject
    >>> MeshObject(trimesh.creation.box((0.1, 0.1, 0.05)), name="box", at=(0, 0, 0.2))
    MeshObject('box', 12 triangles, closed, 100 x 100 x 50 mm at (0, 0, 0.2) m)
    """

    _on: dict[str, Any]  # by device: a Surface, a Warp struct that type checkers do not know
    _fields: dict[str, Field]

    def __init__(
        self,
        vertices: Any,
        faces: np.ndarray | None = None,
        *,
        name: str = "mesh",
        placement: Placement | None = None,
        solid: str = "winding",
        weld: float = 0.0,
        fill_holes: float = 0.0,
        watch: Watch = unwatched,
        **place: Unpack[PlacementFields],
    ) -> None:
        self.name = name
        self.solid = require_solid_rule(solid)
        """What counts as inside: "winding" (winding number > 0) or "even-odd" (an odd winding number)."""
        self.placement = placement_of(placement, **place)
        if faces is not None and (hasattr(vertices, "faces") or hasattr(vertices, "extract_surface")):
            raise MeshError(f"{name}: the mesh given has faces of its own: leave out the others")
        if faces is None:
            vertices, faces = foreign_arrays(vertices)
        vertices, faces = np.asarray(vertices), np.asarray(faces)
        if vertices.dtype.kind in "US":
            raise MeshError(f"{name}: vertices must be numbers, not text; MeshObject.load(path) loads a file")
        self._scale = self.placement.factor_of(vertices)
        repaired = repaired_mesh(vertices, faces, self._repair(weld, fill_holes), watch)
        self.report = repaired.report
        """Faults found and repairs made; lengths in the unit of the vertices as given."""
        self._solid_count = repaired.solid_count
        self._repair_options = {"solid": self.solid, "weld": weld, "fill_holes": fill_holes}
        self.vertices = self.placement.applied_to(repaired.vertices).astype(np.float32)
        """[m], float32, shape [vertex, 3]."""
        self.faces = repaired.faces.astype(np.int32)
        """int32, shape [face, 3]; first the faces that bound the solid, then those of open surfaces."""
        self.begin_copies()
        self.detail: dict[str, Any] | None = None
        """Result of `simplify`; None if the mesh was not simplified."""
        self._warn_of_report()
        self._check_size()
        self._check_rounding(repaired.vertices)

    @classmethod
    def load(
        cls,
        source: Any,
        *,
        placement: Placement | None = None,
        solid: str = "winding",
        weld: float = 0.0,
        fill_holes: float = 0.0,
        watch: Watch = unwatched,
        **place: Unpack[PlacementFields],
    ) -> "MeshObject":
        """Load a built-in object by name, a mesh file (STL, OBJ, PLY, OFF, GLB, glTF), or a library's mesh.

        Other arguments and errors as for the class.

        >>> MeshObject.load("tube", fit=0.1)
        MeshObject('tube', 256 triangles, closed, 100 x 100 x 100 mm at (0, 0, 0.2) m)
        """
        options: Any = {
            "placement": placement_of(placement, **place),
            "solid": solid,
            "weld": weld,
            "fill_holes": fill_holes,
            "watch": watch,
        }
        if not isinstance(source, str | Path):
            return cls(source, **options)
        if (name := shape_name(str(source))) is not None:
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

    def _warn_of_report(self) -> None:
        phrases = self.report.changes() + self.report.faults(self._scale)
        if phrases:
            warn_user(f"{self.name}: " + "; ".join(phrases))

    def _check_size(self) -> None:
        if not np.isfinite(self.vertices).all():
            raise MeshError(f"{self.name}: coordinates overflow after placement (scale {self.placement.scale})")
        fit = self.placement.fit
        way = "like a file in millimetres: use scale=0.001, or fit=0.13"
        if fit is not None:
            way = f"lengths are in metres, {fit:g} mm are fit={fit / 1000:g}"
        warn_of_place(self.name, self.bounds, way, self.placement.at)

    def _check_rounding(self, vertices: np.ndarray) -> None:
        allowed = len(vertices) // 100
        placed = self.vertices + np.float32(0)  # -0 is 0
        if repeats_at_most(placed) <= allowed:
            return
        lost = len(vertices) - len(np.unique(placed, axis=0))
        if lost > allowed:
            warn_user(
                f"{self.name}: {lost} of {len(vertices)} vertices fall on others in float32, which steps by "
                f"{np.spacing(np.abs(self.vertices).max()):.2g} m this far from the array: at=(0, 0, 0.2) is nearer"
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
            edges = _EDGES[self.identity] = edges_of_mesh(self.vertices, self.faces, self.identity)
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
        ways = [*report.closing(self._scale), self.voxelising()]
        raise MeshError(
            f"{self.name}: closed contours (CC), hand meshes and contact need a closed surface, but {fault}. "
            f'Ways out: {", ".join(ways)}, strategy="oc" accepts any mesh on palms, or close the mesh in a mesh editor'
        )

    def voxelising(self) -> str:
        """The command that makes a closed solid of the mesh, with voxels of a hundredth of its longest side."""
        spacing = float(np.ptp(self.bounds, axis=0).max()) / VOXELS_ACROSS
        scale = "" if self._scale == 1.0 else f" --scale {self._scale:.4g}"
        out = f"{Path(self.name).stem}.npz"
        return f"palpate voxelise {self.name}{scale} --spacing {spacing:.2g} -o {out} makes a closed solid of it"

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
        for name in ("edges", "identity", "solid_part", "sheet_part", "gap"):
            out.__dict__.pop(name, None)
        out.faces, out.report = faces, report
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

    @cached_property
    def gap(self) -> float:
        """How far from each other faces may count as one place [m]; 0 if none lie on each other for sure.

        Vertices are rounded to float32, so between faces that touched there are gaps and walls of that width. Faces
        that merely look opposite ways in one plane count, too: telling them apart would take longer than it saves.
        """
        touches = self.solid != "winding" or _has_opposite_planes(self.vertices.astype(np.float64), self.faces)
        spacing = float(np.spacing(np.abs(self.vertices).max()))
        return min(ROUNDINGS * spacing, GAP_LARGEST) if touches else 0.0

    def __repr__(self) -> str:
        """One line: name, triangles, whether it is closed, size and place."""
        kind = "closed" if self.report.closed else f"{self.report.open_edges} open edges"
        return f"MeshObject({self.name!r}, {len(self.faces)} triangles, {kind}, {place_text(self.bounds)})"

    def to_trimesh(self) -> "trimesh.Trimesh":
        """The mesh for trimesh, in metres, as it was placed and repaired.

        >>> MeshObject.load("cube").to_trimesh().volume.round(6)
        np.float64(0.002197)
        """
        return trimesh_mesh(self.vertices, self.faces)

    def to_pyvista(self) -> "pyvista.PolyData":
        """The mesh for PyVista, in metres, as it was placed and repaired; raises MeshError without PyVista."""
        return pyvista_mesh(self.vertices, self.faces)

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


def is_mesh_name(source: str) -> bool:
    """Whether a file's name, or a built-in one, is that of a mesh."""
    return shape_name(source) is not None or Path(source).suffix.lower() in MESH_SUFFIXES


def mesh_facts(source: str, options: dict[str, Any], watch: Watch = unwatched) -> dict[str, Any]:
    """The mesh in numbers, and in sentences what was changed, what is left, and what could be done.

    options: `scale` and those of `MeshObject.load`; None among them is an option not given. Raises MeshError.
    """
    given = {name: value for name, value in options.items() if value is not None}
    placement = Placement(scale=given.pop("scale", 1.0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PalpateWarning)
        mesh = MeshObject.load(source, placement=placement, watch=watch, **given)
    report = mesh.report
    told = "; ".join(report.changes() + report.faults(placement.scale))  # the table has it row by row
    texts = [str(warning.message).removeprefix(f"{mesh.name}: ") for warning in caught]
    numbers = asdict(report)
    for name in ("rim_longest", "fill_closes", "weld_closes"):
        numbers[name] *= placement.scale
    return {
        "size": np.ptp(mesh.bounds, axis=0).tolist(),
        "triangles_kept": len(mesh.faces),
        "vertices_kept": len(mesh.vertices),
        "solid": mesh.solid,
        **numbers,
        "closed_contours": closed_contours(mesh),
        "changed": "; ".join(report.changes()) or "nothing",
        "left": "; ".join(report.faults(placement.scale)) or "nothing",
        "warned": "; ".join(text for text in texts if text != told),
        "could_be_done": "; ".join(ways_out(mesh, placement.scale)) or "nothing needed",
    }


def closed_contours(mesh: MeshObject) -> str:
    """Whether CC can be had of a mesh."""
    if not mesh.report.closed:
        return "refused: inside and outside are not defined"
    return "exact" if mesh.is_simple else "regularised pose by pose"


def ways_out(mesh: MeshObject, scale: float) -> list[str]:
    """What a user could do about what is left, one phrase each; scale: metres of the object as placed a unit."""
    report, out = mesh.report, []
    if scale == 1.0 and np.ptp(mesh.bounds, axis=0).max() > SIZE_LARGEST:
        out.append("scale=0.001 takes the file as one in millimetres")
    if Path(mesh.name).suffix.lower() in GLTF_SUFFIXES and mesh.placement.up == "z":
        out.append('up="y" raises what the file has upright: +Y is up in glTF')
    out += report.closing(scale)
    if not report.closed:
        out.append(mesh.voxelising())
    return out
