"""The peers, one class a library, each in the setting that was measured as its fastest for one core."""

import ctypes
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from peers import COMPLETION, Absence, Declined, Peer
from section_completion import PalmFrames, Polylines, offsets, rings_of, stitched

from palpate.render.strategies.intersection_strategy import IntersectionStrategy


class MeshLib(Peer):
    """Sections by its tree of boxes, brought to the palm's frame by itself; shells run clockwise seen from +n."""

    name = "meshlib"
    packages = ("meshlib",)
    modules = ("meshlib.mrmeshpy", "meshlib.mrmeshnumpy")
    licence = "non-commercial"
    turn = -1

    def prepare(self) -> None:
        """Mesh and tree."""
        self.library: Any = import_module("meshlib.mrmeshpy")
        self.mesh = import_module("meshlib.mrmeshnumpy").meshFromFacesVerts(self.faces, self.vertices)
        self.part = self.library.MeshPart(self.mesh)
        self.mesh.getAABBTree()

    def rings(self, frames: PalmFrames) -> Polylines:
        """One call a pose; points are copied from the vector's memory, half the time of its own conversion."""
        library, vector = self.library, self.library.Vector3f
        back = -np.einsum("pij,pj->pi", frames.axes, frames.centre)
        rings, poses = [], []
        for pose, (axes, move) in enumerate(zip(frames.axes.tolist(), back.tolist(), strict=True)):
            u, v, n = (vector(*axis) for axis in axes)
            sections = library.extractPlaneSections(self.part, library.Plane3f(n, -move[2]))
            if not len(sections):
                continue
            to_palm = library.AffineXf3f(library.Matrix3f(u, v, n), vector(*move))
            for ring in library.planeSectionsToContours2f(self.mesh, sections, to_palm):
                memory: Any = (ctypes.c_float * (2 * len(ring))).from_address(ring.data_pointer())
                rings.append(np.frombuffer(memory, np.float32).reshape(-1, 2).copy())  # a vector of pairs of floats
                poses.append(pose)
        return rings_of(rings, poses, repeats=True)


class Vtk(Peer):
    """vtkPolyDataPlaneCutter without normals and attributes, then vtkStripper to order what it gives."""

    name = "vtk"
    packages = ("vtk",)
    modules = ("vtkmodules.vtkFiltersCore", "vtkmodules.util.numpy_support")
    licence = "BSD-3-Clause"

    def prepare(self) -> None:
        """The pipeline: plane, cutter, stripper."""
        core, model, common, arrays = (
            import_module(f"vtkmodules.{name}")
            for name in ("vtkFiltersCore", "vtkCommonDataModel", "vtkCommonCore", "util.numpy_support")
        )
        common.vtkSMPTools.SetBackend("Sequential")
        points, cells, data = common.vtkPoints(), model.vtkCellArray(), model.vtkPolyData()
        points.SetData(arrays.numpy_to_vtk(self.vertices, deep=True))
        start = np.arange(0, 3 * len(self.faces) + 1, 3, dtype=np.int64)
        ids = (arrays.numpy_to_vtkIdTypeArray(x, deep=True) for x in (start, self.faces.ravel()))
        cells.SetData(*ids)
        data.SetPoints(points)
        data.SetPolys(cells)
        self.plane, cutter, self.stripper = model.vtkPlane(), core.vtkPolyDataPlaneCutter(), core.vtkStripper()
        cutter.SetInputData(data)
        cutter.SetPlane(self.plane)
        cutter.ComputeNormalsOff()
        cutter.InterpolateAttributesOff()
        cutter.SetOutputPointsPrecision(1)  # double
        self.stripper.SetInputConnection(cutter.GetOutputPort())
        self.stripper.JoinContiguousSegmentsOn()
        self.stripper.SetMaximumLength(2**30)
        self.numpy = arrays.vtk_to_numpy

    def rings(self, frames: PalmFrames) -> Polylines:
        """One update of the pipeline a pose."""
        points, sizes, poses = [np.zeros((0, 3))], [np.zeros(0, np.int64)], []
        normal = frames.axes[:, 2].tolist()
        for pose, centre in enumerate(frames.centre.tolist()):
            self.plane.SetOrigin(centre)
            self.plane.SetNormal(normal[pose])
            self.stripper.Update()
            section = self.stripper.GetOutput()
            lines = section.GetLines()
            if not lines.GetNumberOfCells():
                continue
            order = self.numpy(lines.GetConnectivityArray())
            points.append(self.numpy(section.GetPoints().GetData())[order])
            sizes.append(np.diff(self.numpy(lines.GetOffsetsArray())))
            poses.extend([pose] * len(sizes[-1]))
        size, pose = np.concatenate(sizes), np.array(poses, np.int64)
        return Polylines(frames.flat(np.concatenate(points), np.repeat(pose, size)), offsets(size), pose)


class Manifold(Peer):
    """The mesh is turned so that the palm lies at height 0, and sliced there; Clipper2 within clips regions."""

    name = "manifold3d"
    packages = ("manifold3d",)
    modules = ("manifold3d",)
    licence = "Apache-2.0"
    turn = 1

    def prepare(self) -> None:
        """Mesh and palm."""
        library = import_module("manifold3d")
        faces = self.faces.astype(np.uint64)
        self.solid = library.Manifold(library.Mesh64(vert_properties=self.vertices, tri_verts=faces))
        if self.solid.is_empty():
            raise Declined(f"manifold3d takes no such mesh: {self.solid.status()}")
        self.palm = library.CrossSection.square((self.hand.width, self.hand.length), True)

    def contours(self, pose: np.ndarray, strategy: IntersectionStrategy) -> Polylines:
        """CC by its own intersection of regions; OC as of every other peer."""
        if not strategy.needs_closed:
            return super().contours(pose, strategy)
        return self._sections(PalmFrames.of(pose), self.palm)

    def rings(self, frames: PalmFrames) -> Polylines:
        """Whole sections."""
        return self._sections(frames, None)

    def _sections(self, frames: PalmFrames, palm: Any) -> Polylines:
        back = -np.einsum("pij,pj->pi", frames.axes, frames.centre)
        to_palm = np.concatenate([frames.axes, back[:, :, None]], axis=2)
        rings, poses = [], []
        for pose, transform in enumerate(to_palm):
            section = self.solid.transform(transform).slice(0.0)
            found = (section if palm is None else section ^ palm).to_polygons()
            rings.extend(found)
            poses.extend([pose] * len(found))
        return rings_of(rings, poses, repeats=False)


class LibIgl(Peer):
    """Isolines of the height over the palm's plane, as segments with shared vertices; shapely joins them."""

    name = "libigl"
    packages = ("libigl",)
    modules = ("igl",)
    licence = "MPL-2.0"

    def prepare(self) -> None:
        """Arrays are all it needs."""
        self.isolines = import_module("igl").isolines

    def rings(self, frames: PalmFrames) -> Polylines:
        """One call a pose."""
        segments, counts = [np.zeros((0, 2, 3))], []
        level = np.zeros(1)
        for centre, axes in zip(frames.centre, frames.axes, strict=True):
            height = self.vertices @ axes[2] - centre @ axes[2]
            points, ends, _ = self.isolines(self.vertices, self.faces, height, level)
            counts.append(len(ends))
            if len(ends):
                segments.append(points[ends])
        return _joined_segments(np.concatenate(segments), counts, frames)


def _joined_segments(segments: np.ndarray, counts: list[int], frames: PalmFrames) -> Polylines:
    """Segments of the array's frame [segment, 2, 3], so many a pose, as polylines of the palms' frames."""
    pose = np.repeat(np.arange(len(counts)), counts)
    flat = frames.flat(segments.reshape(-1, 3), np.repeat(pose, 2)).reshape(-1, 2, 2)
    return stitched(flat, pose)


class Trimesh(Peer):
    """`mesh_plane` gives segments; their ends differ in the last bits, are rounded to 1e-10 m and joined by shapely.

    Four times as fast as `Trimesh.section`, which builds a graph of them.
    """

    name = "trimesh"
    packages = ("trimesh",)
    modules = ("trimesh",)
    licence = "MIT"

    def prepare(self) -> None:
        """A mesh as it is, without a second welding."""
        library: Any = import_module("trimesh")
        self.mesh = library.Trimesh(self.vertices, self.faces, process=False)
        self.cut = library.intersections.mesh_plane

    def rings(self, frames: PalmFrames) -> Polylines:
        """One call a pose."""
        found = [self.cut(self.mesh, axes[2], at) for at, axes in zip(frames.centre, frames.axes, strict=True)]
        segments = np.concatenate([np.zeros((0, 2, 3)), *found])
        return _joined_segments(np.round(segments, 10), [len(part) for part in found], frames)


class CompasCgal(Peer):
    """CGAL's slicer for many planes in one call, which builds mesh and tree anew, and does not say which plane it was.

    Polylines come in the order of their planes: each belongs to the first plane from the last one on that it lies in.
    """

    name = "compas_cgal"
    packages = ("compas_cgal",)
    modules = ("compas_cgal.slicer",)
    licence = "LGPL-3.0 (CGAL's slicer: GPL-3.0)"
    turn = 1
    rebuilds = True

    def prepare(self) -> None:
        """Arrays are all it takes."""
        self.slice = import_module("compas_cgal.slicer").slice_mesh

    def rings(self, frames: PalmFrames) -> Polylines:
        """All planes in one call."""
        centre, normal = frames.centre.tolist(), frames.axes[:, 2].tolist()
        found = self.slice((self.vertices, self.faces), list(zip(centre, normal, strict=True)))
        rings = [ring for ring in found if len(ring) > 3]  # a touched vertex comes out as a polyline of one point
        poses = _planes_of(rings, normal, np.einsum("pi,pi->p", frames.axes[:, 2], frames.centre).tolist())
        flat = rings_of([ring[:, :2] for ring in rings], poses, repeats=True)
        points = np.concatenate([np.zeros((0, 3)), *rings])
        return Polylines(frames.flat(points, np.repeat(flat.pose, flat.size)), flat.start, flat.pose)


def _planes_of(rings: list[np.ndarray], normal: list[list[float]], height: list[float]) -> list[int]:
    """Which plane each ring lies in; both are in the same order."""
    poses, pose = [], 0
    for ring in rings:
        first, other = ring[0].tolist(), ring[len(ring) // 3].tolist()
        while not (_lies_in(first, normal[pose], height[pose]) and _lies_in(other, normal[pose], height[pose])):
            pose += 1
        poses.append(pose)
    return poses


def _lies_in(point: list[float], normal: list[float], height: float) -> bool:
    return abs(point[0] * normal[0] + point[1] * normal[1] + point[2] * normal[2] - height) < 1e-9


PEERS: dict[str, type[Peer]] = {peer.name: peer for peer in (MeshLib, Vtk, Manifold, LibIgl, Trimesh, CompasCgal)}


def find_peers(wanted: Sequence[str]) -> tuple[list[Peer], list[Absence]]:
    """Of the peers of these names (all, none) those that are installed, and the others with the reason.

    Raises SystemExit for an unknown name.
    """
    names = {("all",): tuple(PEERS), ("none",): ()}.get(tuple(wanted), tuple(wanted))
    if unknown := set(names) - PEERS.keys():
        raise SystemExit(f"unknown peers {', '.join(sorted(unknown))}; known: {', '.join(PEERS)}, all, none")
    reasons = {name: _missing(PEERS[name]) for name in names}
    found = [PEERS[name]() for name, reason in reasons.items() if not reason]
    return found, [Absence(name, reason) for name, reason in reasons.items() if reason]


def _missing(peer: type[Peer]) -> str:
    """Why a peer cannot run here, or nothing."""
    for module in (*peer.modules, *COMPLETION):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # what a library warns of itself when imported is nothing of ours
                import_module(module)
        except (ImportError, OSError) as error:  # OSError: a shared library that it links to is missing
            return f"cannot be imported ({module}: {error})"
    try:
        for package in (*peer.packages, *COMPLETION):
            version(package)
    except PackageNotFoundError as error:
        return f"not installed (no distribution {error})"
    return ""
