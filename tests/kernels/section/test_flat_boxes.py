"""Packed boxes hold what they bound, packed corners are near those of the faces; decoded here by NumPy."""

import numpy as np
import pytest
import warp as wp
from drawing import assert_same_bits, draw, patch_array, surface_on
from mesh_cases import generic_poses

from palpate.kernels.section.flat_boxes import pack_boxes
from palpate.kernels.section.half_edges import LEAF, HalfEdges
from palpate.render.bench.cases import blob

PLACES = {
    "here": (1.0, [0, 0, 0]),
    "1 km away": (1.0, [1000, -300, 20]),
    "a thousandth": (1e-3, [0, 0, 0]),
    "300 m wide": (2000.0, [0, 0, 0]),
}


def sheet():
    """An open square of 400 faces in one plane."""
    x, y = np.meshgrid(np.linspace(-0.05, 0.05, 15), np.linspace(-0.05, 0.05, 15))
    vertices = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.2)], axis=1)
    corner = (np.arange(14)[:, None] * 15 + np.arange(14)).ravel()
    return vertices, np.concatenate(
        [np.stack([corner, corner + 1, corner + 16], axis=1), np.stack([corner, corner + 16, corner + 15], axis=1)]
    )


MESHES = {"blob": lambda: blob(12), "sheet": sheet, "triangle": lambda: (np.eye(3), np.arange(3)[None])}


def placed(mesh, place):
    vertices, faces = mesh
    scale, offset = PLACES[place]
    return scale * np.asarray(vertices, np.float64) + offset, faces


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", MESHES)
def test_packed_boxes_hold_boxes_and_corners(name, place, device):
    vertices, faces = placed(MESHES[name](), place)
    edges = HalfEdges(vertices, faces)
    surface = surface_on((vertices, faces), device)
    pack_boxes(surface, wp.get_device(device))
    step, low = 1.0 / float(surface.box_scale), np.array(surface.box_low, np.float64)
    words = surface.packed_box.numpy().reshape(-1, 4)
    middle, extent = words[:, :3] & 0x7FFF, words[:, :3] >> 16
    ends = low + step * np.stack([middle - extent, middle + extent], axis=1)
    full = edges.boxes.half[:, 0] >= 0
    full[0] = False  # the heap begins with 1
    rounding = 4 * np.spacing(np.float32(np.abs(vertices).max()))
    assert (words[1:, 3] == full[1:]).all()
    centre, half = edges.boxes.centre[full].astype(np.float64), edges.boxes.half[full].astype(np.float64)
    assert (ends[full, 0] <= centre - half + rounding).all()
    assert (ends[full, 1] >= centre + half - rounding).all()
    size = 2.0 * edges.boxes.half[1].max()
    assert (ends[full, 1] - ends[full, 0] <= 2 * half + 4.3 * size / 32700 + 2 * rounding).all()
    corner = surface.packed_face.numpy().reshape(-1, 4)
    assert (corner[:, 3] == (np.arange(len(corner)) < len(faces))).all()
    box = ends[edges.boxes.leaf_first + np.arange(len(faces)) // LEAF]
    word = corner[: len(faces), :3].view(np.uint32)
    parts = np.stack([word >> 13 & 1023, word >> 3 & 1023, word >> 23 | (word & 1) << 9], axis=2)
    part = (box[:, 1] - box[:, 0]) / 1023
    x = box[:, None, 0] + parts * part[:, None]
    assert (np.abs(x - edges.vertices[edges.faces]) <= 0.5 * part[:, None] + 2 * rounding).all()


def test_a_surface_gets_its_packed_boxes_whole(device, monkeypatch):
    """Another thread may search it, or pack it too, at any time."""
    surface, own, seen = surface_on(blob(6), device), wp.launch, []

    def launch(*arguments, **options):
        seen.append((surface.packed_box, surface.packed_face))
        return own(*arguments, **options)

    monkeypatch.setattr(wp, "launch", launch)
    pack_boxes(surface, wp.get_device(device))
    assert all(box is None and face is None for box, face in seen)
    assert len(seen) == 2
    assert surface.packed_box.shape[0] > 0


@pytest.mark.parametrize("place", PLACES)
def test_bits_are_those_of_walking_wherever_the_surface_lies(place, device):
    scale, offset = PLACES[place]
    poses = generic_poses(100, 3).astype(np.float64)
    poses[:, :3] = scale * poses[:, :3] + offset
    surface = surface_on(placed(blob(12), place), device)
    patch = patch_array(scale * np.array([0.0425, 0.03]), device)
    sought, flat = (draw(surface, poses.astype(np.float32), patch, "cc", method) for method in ("tree", "flat"))
    assert_same_bits(sought, flat)
    assert len(flat.points) > 1000
