"""What a file is that is no contour file, by its name and its first bytes, and which command takes it."""

import re
from pathlib import Path

from ..datasets.bounded_file import FileBoundError, open_regular

MESH_SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb", ".gltf")
VOLUME_SUFFIXES = (".npy", ".npz", ".nrrd", ".nhdr", ".nii", ".nii.gz", ".nvdb")
_OF_BLENDER = "a scene of a format that is not read: Blender, for one, opens it and exports STL, PLY or glTF"
NOT_READ = {
    ".3mf": "a 3MF file, whose millimetres and parts are not read: save it as STL in the program that made it",
    ".zip": "an archive: unpack it, and give the mesh that it holds",
    **dict.fromkeys((".step", ".stp", ".iges", ".igs"), "a CAD file without triangles: export STL from a CAD program"),
    **dict.fromkeys((".fbx", ".dae", ".blend", ".3ds", ".x3d", ".wrl"), _OF_BLENDER),
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), _OF_BLENDER),
    **dict.fromkeys((".vtk", ".vtp", ".vtu"), "a file of VTK: MeshObject(pyvista.read(path)) takes it in Python"),
}
"""Files of triangles that are not read, and the way out, by the end of their name."""

FOCUS_MAGIC = b"PALPATEF"
"""The first bytes of a binary file of focal points (docs/formats/focal-points.md)."""

_SNIFFED = 1 << 16
_OBJECT = "palpate render {0} MOTION -o OUT.h5 makes a contour file of it"
_MOTION = "palpate render OBJECT {0} -o OUT.h5 makes a contour file of it"
_KINDS = {
    "mesh": f"a mesh: palpate info {{0}} describes it, {_OBJECT}",
    "volume": f"a volume of voxels: {_OBJECT}",
    "expression": f"an expression, which is an object: {_OBJECT}",
    "motion": f"a motion or a recording of a hand: {_MOTION}",
    "strategy": "a strategy: palpate render OBJECT MOTION --strategy {0} -o OUT.h5 takes it",
    "alignment": "an alignment: palpate render OBJECT RECORDING --alignment {0} -o OUT.h5 takes it",
    "export": "contours as palpate export writes them and palpate does not read them: give their contour file",
    "focus": "focal points as palpate export writes them, which palpate-ultraleap plays (.bin) and palpate does not "
    "read: give the file that they were exported from",
    "scene": "an export to VTKHDF, which ParaView reads and palpate does not: give the contour file of it",
    "points": "a point list: palpate play {0} takes it",
    "plan": "a plan of a sweep: palpate sweep {0} makes it",
    "function": "Python source: palpate render {0}:FUNCTION MOTION --bounds ... -o OUT.h5 takes a function of it",
}


def described_file(path: Path) -> str | None:
    """What a file is, and what takes it, for a message; None if it may be a contour file, or is not known."""
    kind = NOT_READ.get(path.suffix.lower())
    return kind or _KINDS.get(_kind_of(path), "").format(path) or None


def is_point_list(path: Path) -> bool:
    """Whether a file is a list of focal points, by its name: what plays takes it, though it is no contour file."""
    return _kind_of(path) == "points"


def _kind_of(path: Path) -> str:
    """One of _KINDS, or nothing."""
    suffix = path.suffix.lower()
    if suffix in (".npz", ".csv"):
        content = _ends_of(path)  # the names of an NPZ file's members, or of a CSV's columns
        if b"polyline_start.npy" in content or re.match(rb"[^\r\n]*\bpolyline,", content):
            return "export"
        if b"update_rate.npy" in content or re.match(rb"time,(point,)?x,y,z,intensity\r?\n", content):
            return "focus"
        return "volume" if b"values.npy" in content else "motion"
    if suffix == ".bin":
        return "focus" if _ends_of(path).startswith(FOCUS_MAGIC) else ""
    if suffix == ".json":
        content = _ends_of(path)  # its keys: only an alignment, an expression or a strategy has these
        if re.match(rb'\s*\{\s*"(position|orientation|matrix)"\s*:\s*\[', content):
            return "alignment"
        if re.search(rb'"op"\s*:', content):
            return "expression"
        return "strategy" if re.search(rb'"(prune|transform|raw)"\s*:', content) else "motion"
    if suffix in MESH_SUFFIXES:
        return "mesh"
    if str(path).lower().endswith(VOLUME_SUFFIXES):
        return "volume"
    return {".toml": "plan", ".py": "function", ".vtkhdf": "scene", ".ptlist": "points"}.get(suffix, "")


def _ends_of(path: Path) -> bytes:
    """The first and the last bytes of a file, where a zip file names its members; none if it cannot be read."""
    try:
        with open_regular(path) as file:
            begin = file.read(_SNIFFED)
            file.seek(max(file.seek(0, 2) - _SNIFFED, 0))
            return begin + file.read()
    except (OSError, FileBoundError):
        return b""
