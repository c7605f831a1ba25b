"""Figure 5B: the five objects of the paper's studies, as palpate has them."""

import numpy as np

from ..objects.mesh.solid_mesh import MeshObject
from ..reports.picture_style import DPI, picture_bytes
from ..reports.report_pages import ReportPicture, ReportSection, drawing
from ..reports.scene_drawing import SceneView, blank, draw_object, flat, set_limits
from .paper_numbers import OBJECTS, ReportRow, compared

PAPER = {
    "tube": "256 triangles; inner over outer radius about 0.61",
    "dog": "136 triangles (1,160 in the picture on the screen); slender, standing",
    "cube": "12 triangles, 130 mm",
    "sphere": "drawn; triangles not given",
    "rock": "a flat lobed slab; triangles not given",
}
WHY = {
    "tube": "Made anew; the radii are 65 and 40 mm.",
    "dog": "Made anew after the figure: the paper's mesh is not published. A finer one is named dog-detailed.",
    "cube": "Nothing differs.",
    "sphere": "An icosahedron divided three times.",
    "rock": "Made anew after the figure: a slab that lies. The paper does not say which way up it is.",
}
TEXT = (
    "The paper's shapes fit a cube of 130 mm whose middle is 200 mm above the array. So do palpate's, each as long as "
    "that cube in its longest direction; each is one closed surface that does not cross itself."
)


def objects_section() -> tuple[ReportSection, dict]:
    """The section, and its values for JSON: triangles, volume [m3] and size [m] of each object."""
    meshes = {name: MeshObject.load(name) for name in OBJECTS}
    values = {
        name: {
            "triangles": len(mesh.faces),
            "size": np.ptp(mesh.bounds, axis=0).tolist(),
            "volume": _volume(mesh.vertices[mesh.faces]),
        }
        for name, mesh in meshes.items()
    }
    rows = tuple(ReportRow(name, PAPER[name], _described(found), WHY[name]) for name, found in values.items())
    section = ReportSection("Figure 5B: the objects", TEXT, (compared(rows),), (_picture(meshes),))
    return section, {"objects": values}


def _described(found: dict) -> str:
    size = " x ".join(f"{1e3 * side:.0f}" for side in found["size"])
    return f"{found['triangles']} triangles, {size} mm, {1e6 * found['volume']:.0f} cm³"


def _volume(corner: np.ndarray) -> float:
    """Volume inside triangles [m3]; corner: [m], shape [face, 3, 3]."""
    return float(np.linalg.det(corner.astype(np.float64) - corner.mean(axis=(0, 1), dtype=np.float64)).sum() / 6.0)


def _picture(meshes: dict[str, MeshObject]) -> ReportPicture:
    basis = SceneView.of("iso").basis()
    with drawing(10.0, 2.5) as figure:
        for axes, (name, mesh) in zip(figure.subplots(1, len(meshes)), meshes.items(), strict=True):
            draw_object(axes, mesh.vertices[mesh.faces], basis)
            blank(axes)
            middle = flat(mesh.bounds.mean(axis=0), basis)
            set_limits(axes, middle, np.full(2, 90.0))  # [mm]; half the diagonal of the paper's cube
            axes.set_title(name, fontsize=10)
        content = picture_bytes(figure, "png", dpi=DPI)  # a sphere of 1,280 shaded triangles is larger as SVG
    alt = "The five objects side by side: tube, dog, cube, sphere and rock"
    return ReportPicture(content, alt, "The built-in objects in the order of the paper's figure 5B.")
