"""Figure 5B: the five objects of the paper's studies, as palpate has them."""

from typing import Any

import numpy as np

from ..objects.mesh.solid_mesh import MeshObject
from ..reports.report_pages import ReportPicture, ReportSection, drawing, picture_content
from ..reports.scene_drawing import NAMED
from .compared_rows import ReportRow, compared
from .paper_numbers import OBJECTS

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
    with drawing(10.0, 2.5) as figure:
        for place, (name, mesh) in enumerate(meshes.items()):
            axes = figure.add_subplot(1, len(meshes), place + 1, projection="3d")
            _draw_object(axes, 1e3 * mesh.vertices[mesh.faces])
            axes.set_title(name, fontsize=10)
        content = picture_content(figure, "png")  # a sphere of 1,280 shaded triangles is larger as SVG
    alt = "The five objects side by side: tube, dog, cube, sphere and rock"
    return ReportPicture(content, alt, "The built-in objects in the order of the paper's figure 5B.")


def _draw_object(axes: Any, triangles: np.ndarray) -> None:
    from matplotlib.colors import LightSource
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    light = LightSource(azdeg=200, altdeg=40)
    body = Poly3DCollection(
        list(triangles), facecolors="#b8c4d6", edgecolors="#5c677d", lw=0.15, shade=True, lightsource=light
    )
    axes.add_collection3d(body)
    extent = triangles.reshape(-1, 3)
    middle = (extent.min(axis=0) + extent.max(axis=0)) / 2
    for name, m in zip("xyz", middle, strict=True):
        getattr(axes, f"set_{name}lim")(m - 65, m + 65)
    axes.set_box_aspect((1, 1, 1), zoom=1.1)
    axes.view_init(elev=NAMED["iso"][0], azim=NAMED["iso"][1])
    axes.set_axis_off()
