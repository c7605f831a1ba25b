"""What is in a mesh file, what loading did to it, and what could be done: `palpate info MESH`."""

import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ....datasets.shapes.built_in import shape_name
from ...errors import PalpateWarning
from ...file_kinds import MESH_SUFFIXES
from ...runtime.loading_progress import Watch, unwatched
from .placement import SIZE_LARGEST, Placement
from .solid_mesh import MeshObject

GLTF_SUFFIXES = (".gltf", ".glb")


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
