"""Figures 3 and 5B: how OC and CC are constructed, and the five objects of the paper's studies."""

from typing import Any

import numpy as np

from ..contour_batch import HAND, OBJECT, ContourBatch
from ..hands.hand import Palm
from ..objects.mesh.solid_mesh import MeshObject
from ..reports.picture_style import COLOURS
from ..reports.report_pages import ReportPicture, ReportSection, drawing, picture_content
from ..reports.scene_drawing import SceneView, blank, draw_object, flat, set_limits
from ..reports.strategy_figure import POSE
from ..scripting.rendering import render
from ..strategies.intersection_strategy import IntersectionStrategy, closed_contour, open_contour
from .paper_numbers import OBJECTS, ReportRow, compared

PALM = Palm(width=0.070, length=0.0896)
"""As in the paper's figure: upright, 1 to 1.28."""
BAR = ((-52.0, -15.0), (46.0, 4.0), 11.0)  # [mm]: ends and radius of what crosses two sides of the palm
DISCS = ((10.0, (-8.0, 24.0)), (17.0, (37.0, 41.0)), (9.0, (-55.0, 38.0)))  # [mm]: inside, over a corner, outside
SOLID_HEIGHT = 60.0  # [mm]
TEXT = (
    "A solid whose section has the cases of the paper's figure: a contour that crosses two sides of the palm, one over "
    "a corner, one wholly on the palm, one wholly beside it. All three panels are drawn from what palpate renders."
)
WHY = "This is the definition, and nothing differs. The paper's figure is a sketch without numbers."


def section_solid() -> MeshObject:
    """The solid: a bar with round ends and three cylinders, which a palm cuts across."""
    from manifold3d import CrossSection

    ends = [CrossSection.circle(BAR[2], 48).translate(end) for end in BAR[:2]]
    parts = [CrossSection.batch_hull(ends), *(CrossSection.circle(size, 48).translate(at) for size, at in DISCS)]
    mesh = (
        (parts[0] + parts[1] + parts[2] + parts[3])
        .extrude(SOLID_HEIGHT)
        .translate((0.0, 0.0, 1e3 * float(POSE[0, 2]) - 0.5 * SOLID_HEIGHT))
        .to_mesh()
    )
    return MeshObject(1e-3 * np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts), name="bar and discs")


def construction_section() -> tuple[ReportSection, dict]:
    """The section, and its values for JSON: lengths of the three steps [m]."""
    solid = section_solid()
    steps = {
        "raw": render(solid, PALM, POSE, IntersectionStrategy()),
        "oc": render(solid, PALM, POSE, open_contour()),
        "cc": render(solid, PALM, POSE, closed_contour()),
    }
    length = {name: float(batch.lengths().sum()) for name, batch in steps.items()}
    shared = float(steps["cc"].lengths()[0, OBJECT])
    raw, opened, closed = (f"{steps[name].polyline_count} polylines, {1e3 * length[name]:.0f} mm" for name in steps)
    rows = (
        ReportRow("raw intersection", "all of the section by the palm's plane", raw, WHY),
        ReportRow("pruning (OC)", "what lies outside the palm is removed", opened, WHY),
        ReportRow("transformation (CC)", "segments along the palm's rectangle close open contours", closed, WHY),
        ReportRow(
            "CC holds OC",
            "CC adds segments to OC",
            f"{1e3 * shared:.1f} mm of CC are the object's; OC has {1e3 * length['oc']:.1f} mm",
            "Nothing differs: one rendering of CC holds both.",
        ),
    )
    section = ReportSection("Figure 3: construction of OC and CC", TEXT, (compared(rows),), (_steps_picture(steps),))
    return section, {"construction": {**length, "oc_within_cc": shared}}


def _steps_picture(steps: dict[str, ContourBatch]) -> ReportPicture:
    titles = ("raw intersection", "pruned: OC", "closed: CC")
    basis = SceneView.of("palm").basis(POSE[0])
    with drawing(9.0, 3.5) as figure:
        panels = figure.subplots(1, 3, sharex=True, sharey=True)
        for axes, title, batch in zip(panels, titles, steps.values(), strict=True):
            _draw_panel(axes, steps["raw"], batch, basis)
            axes.set_title(title, fontsize=10, loc="left")
        figure.legend(handles=_legend(), loc="outside lower center", ncols=4, frameon=False)
        content = picture_content(figure)
    alt = "Three panels: the section of a solid by the palm's plane, its part on the palm, and that part closed"
    return ReportPicture(content, alt, "Raw intersection, OC and CC of one pose (the paper's figure 3).")


def _draw_panel(axes: Any, raw: ContourBatch, batch: ContourBatch, basis: np.ndarray) -> None:
    """Section and palm as areas, contours as lines by kind."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Polygon, Rectangle

    u, v = 500 * PALM.width, 500 * PALM.length
    for loop in raw.polylines_of(0):
        axes.add_patch(Polygon(flat(loop, basis), facecolor=COLOURS["mesh"], alpha=0.25, edgecolor="none"))
    axes.add_patch(Rectangle((-u, -v), 2 * u, 2 * v, facecolor=COLOURS["palm"], alpha=0.25, edgecolor="none"))
    axes.add_patch(Rectangle((-u, -v), 2 * u, 2 * v, fill=False, edgecolor=COLOURS["palm"], lw=1.0, ls=(0, (4, 2))))
    points = flat(batch.points, basis)
    here = np.setdiff1d(np.arange(batch.point_count), batch.polyline_start[1:] - 1)
    ends = np.stack([points[here], points[here + 1]], axis=1)
    colours = [COLOURS["hand" if kind == HAND else "object"] for kind in batch.kind[here].tolist()]
    axes.add_collection(LineCollection(list(ends), colors=colours, lw=2.2, capstyle="round"))
    axes.set_xlim(-68, 60)
    axes.set_ylim(-52, 62)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _legend() -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Line2D([], [], color=COLOURS["object"], lw=2.2, label="the object's contour"),
        Line2D([], [], color=COLOURS["hand"], lw=2.2, label="along the palm's boundary"),
        Patch(facecolor=COLOURS["palm"], alpha=0.3, label="palm"),
        Patch(facecolor=COLOURS["mesh"], alpha=0.3, label="section of the solid"),
    ]


PAPER_OBJECTS = {
    "tube": "256 triangles; inner over outer radius about 0.61",
    "dog": "136 triangles (1,160 in the picture on the screen); slender, standing",
    "cube": "12 triangles, 130 mm",
    "sphere": "drawn; triangles not given",
    "rock": "a flat lobed slab; triangles not given",
}
WHY_OBJECTS = {
    "tube": "Made anew; the radii are 65 and 40 mm.",
    "dog": "Made anew after the figure: the paper's mesh is not published. A finer one is named dog-detailed.",
    "cube": "Nothing differs.",
    "sphere": "An icosahedron divided three times.",
    "rock": "Made anew after the figure: a slab that lies. The paper does not say which way up it is.",
}
TEXT_OBJECTS = (
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
    rows = tuple(
        ReportRow(name, PAPER_OBJECTS[name], _described(found), WHY_OBJECTS[name]) for name, found in values.items()
    )
    section = ReportSection("Figure 5B: the objects", TEXT_OBJECTS, (compared(rows),), (_objects_picture(meshes),))
    return section, {"objects": values}


def _described(found: dict) -> str:
    size = " x ".join(f"{1e3 * side:.0f}" for side in found["size"])
    return f"{found['triangles']} triangles, {size} mm, {1e6 * found['volume']:.0f} cm³"


def _volume(corner: np.ndarray) -> float:
    """Volume inside triangles [m3]; corner: [m], shape [face, 3, 3]."""
    return float(np.linalg.det(corner.astype(np.float64) - corner.mean(axis=(0, 1), dtype=np.float64)).sum() / 6.0)


def _objects_picture(meshes: dict[str, MeshObject]) -> ReportPicture:
    basis = SceneView.of("iso").basis()
    with drawing(10.0, 2.5) as figure:
        for axes, (name, mesh) in zip(figure.subplots(1, len(meshes)), meshes.items(), strict=True):
            draw_object(axes, mesh.vertices[mesh.faces], basis)
            blank(axes)
            middle = flat(mesh.bounds.mean(axis=0), basis)
            set_limits(axes, middle, np.full(2, 90.0))  # [mm]; half the diagonal of the paper's cube
            axes.set_title(name, fontsize=10)
        content = picture_content(figure, "png")  # a sphere of 1,280 shaded triangles is larger as SVG
    alt = "The five objects side by side: tube, dog, cube, sphere and rock"
    return ReportPicture(content, alt, "The built-in objects in the order of the paper's figure 5B.")
