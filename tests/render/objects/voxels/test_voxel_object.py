"""Volumes as objects: what values mean, where they lie, and what is refused in one sentence."""

import threading

import numpy as np
import pytest
import trimesh
from field_points import values_at
from scipy.spatial.transform import Rotation
from voxel_cases import TURNED, ball, balled, coordinates

from palpate.render import MeshObject, Placement
from palpate.render.errors import MeshError, PalpateWarning, VoxelError
from palpate.render.objects.solid import Solid
from palpate.render.objects.voxels.grid import applied, box_of, crossing_points
from palpate.render.objects.voxels.voxel_object import VoxelObject


def surface_distances(thing, radius=0.03):
    """Of the outline from a ball around (0, 0, 0.2) [m]."""
    vertices, _ = thing.outline_mesh()
    return np.abs(np.linalg.norm(vertices - [0, 0, 0.2], axis=1) - radius)


def test_a_ball_of_distances_is_a_ball(device):
    thing = balled()
    assert isinstance(thing, Solid)
    thing.require_closed()
    assert surface_distances(thing).max() < 2e-4
    np.testing.assert_allclose(thing.bounds, [[-0.03, -0.03, 0.17], [0.03, 0.03, 0.23]], atol=2e-4)
    field = thing.field_on(device)
    assert thing.field_on(device) is field
    np.testing.assert_array_equal(
        values_at(field, [[0, 0, 0.2], [0.029, 0, 0.2], [0.031, 0, 0.2]], device) < 0, [1, 1, 0]
    )


def test_every_meaning_of_values_gives_the_same_inside():
    distance = ball()
    inside = distance < 0
    labels = np.where(inside, 7, np.where(distance < 0.005, 3, 0)).astype(np.int16)
    labels[inside & (coordinates(inside.shape)[..., 0] > 10)] = 9
    for thing in (
        balled(inside, kind=None),
        balled(inside.astype(np.uint8), kind=None),
        balled(inside.astype(np.float64), kind="occupancy"),
        balled(labels, kind=None, label=(7, 9)),
        balled(labels.astype(np.float32), kind="label", label=[9, 7.0]),
        balled(labels, kind="label", label=np.array([9, 7])),
        balled(np.ma.masked_array(distance)),
        balled(-distance, inside="above"),
        balled(100 - 1e3 * distance, kind=None, level=100.0),
        balled(1e3 * distance, kind="intensity", level=0.0, inside="below"),
        balled(distance + 0.5, level=0.5),
        balled(distance.astype(">f8")),
        balled(np.asfortranarray(distance)),
    ):
        np.testing.assert_array_equal(thing.values < 0, inside)
        assert thing.inside_count == inside.sum()


def test_smoothing_is_as_wide_in_metres_along_each_axis():
    """A Gaussian of 6 mm, of which voxels of 4, 5 and 3 mm take samples, has that standard deviation."""
    one = np.zeros((25, 25, 25), bool)
    one[9:16, 9:16, 9:16] = True
    weight = 0.5 - balled(one, kind=None, smooth=0.006).values.astype(np.float64)
    for axis, size in enumerate((0.004, 0.005, 0.003)):
        along = weight.sum(axis=tuple({0, 1, 2} - {axis}))
        place = size * (np.arange(25) - 12)
        variance = (along * place**2).sum() / along.sum() - size**2 * (7**2 - 1) / 12  # less that of the cube
        assert np.sqrt(variance) == pytest.approx(0.006, rel=0.02)


def test_a_stretch_of_zeros_ends_the_solid_at_its_inner_end_whatever_lies_beyond():
    values = np.full((9, 9, 9), 1e9)
    values[2:7, 2:7, 2:7] = 0.0
    values[3:6, 3:6, 3:6] = -1.0
    thing = balled(values, spacing=1.0, placement=Placement(scale=1e-2, at=(0, 0, 0.2)))
    np.testing.assert_allclose(np.ptp(thing.bounds, axis=0), 0.04, atol=1e-6)


def test_the_same_solid_in_any_order_of_axes_is_the_same_field(rng, device):
    distance = ball()
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = TURNED * [0.004, 0.005, 0.003], [0.01, 0.02, 0.2]
    one = VoxelObject(distance, affine=affine, kind="distance")
    swapped = affine[:, [2, 0, 1, 3]]
    mirrored = affine.copy()
    mirrored[:, 1] *= -1
    mirrored[:, 3] += affine[:, 1] * (distance.shape[1] - 1)
    points = rng.uniform(*one.bounds, size=(500, 3))
    expected = values_at(one.field_on(device), points, device)
    for values, other in ((distance.transpose(2, 0, 1), swapped), (distance[:, ::-1], mirrored)):
        two = VoxelObject(values, affine=other, kind="distance")
        np.testing.assert_allclose(values_at(two.field_on(device), points, device), expected, atol=1e-9)
        np.testing.assert_allclose(two.bounds, one.bounds, atol=1e-9)
    three = VoxelObject(
        distance, spacing=(0.004, 0.005, 0.003), origin=(0.01, 0.02, 0.2), direction=TURNED, kind="distance"
    )
    np.testing.assert_allclose(three.affine, affine, atol=1e-15)


@pytest.mark.parametrize("flip", [1, -1])
def test_the_outline_is_closed_and_faces_outwards(flip):
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = TURNED * [0.004 * flip, 0.005, 0.003], [0.0, 0.0, 0.2]
    mesh = trimesh.Trimesh(*VoxelObject(ball(), affine=affine, kind="distance").outline_mesh(), process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.03**3, rel=0.02)


def test_bounds_hold_all_that_is_inside(rng):
    beyond = 0
    for turn in Rotation.random(3, random_state=0).as_matrix():
        affine = np.eye(4)
        affine[:3, :3], affine[2, 3] = 0.01 * turn, 0.4
        with pytest.warns(PalpateWarning, match="border"):
            thing = VoxelObject(rng.normal(size=(10, 10, 10)) + 0.6, affine=affine, kind="distance")
        points = applied(affine, rng.uniform(-2, 12, (100_000, 3)))
        inside = points[values_at(thing.field_on("cpu"), points, "cpu") < 0]
        assert len(inside) > 2000
        assert ((inside >= thing.bounds[0]) & (inside <= thing.bounds[1])).all()
        crossings = box_of(applied(affine, crossing_points(np.pad(thing.values, 1, constant_values=1.0))))
        beyond += int(((inside < crossings[0]) | (inside > crossings[1])).sum())
    assert beyond  # so the crossings' own box would not do


def test_placement_moves_voxels_as_it_moves_the_mesh_of_their_surface():
    block = np.zeros((8, 9, 7), bool)
    block[2:6, 1:8, 3:5] = True
    free = VoxelObject(block, spacing=(0.01, 0.02, 0.015), origin=(0.0, 0.0, 0.1))
    for placement in (
        Placement(fit=0.13, at=(0.01, 0.02, 0.3)),
        Placement(scale=0.5, up="y"),
        Placement(up="-x", fit=0.1, rotate=(20.0, 0.0, 0.0), at=(0, 0, 0.2)),
        Placement(rotate=(0.0, 90.0, 30.0), at=(0, 0, 0.2)),
    ):
        vertices, faces = free.outline_mesh()
        expected = MeshObject(vertices, faces, placement=placement).vertices
        thing = VoxelObject(block, spacing=(0.01, 0.02, 0.015), origin=(0.0, 0.0, 0.1), placement=placement)
        found = thing.outline_mesh()[0]
        assert np.linalg.norm(np.sort(found, axis=0) - np.sort(expected, axis=0), axis=1).max() < 1e-6
        assert np.array_equal(thing.values, free.values)


def test_identity_tells_values_and_places_apart():
    one = balled()
    assert one.identity == balled().identity
    assert one.identity == balled(name="other").identity
    changed = ball()
    changed[10, 10, 10] -= 1e-6
    for other in (
        balled(changed),
        balled(spacing=(0.004, 0.005, 0.0031)),
        balled(placement=Placement(at=(0, 0, 0.21))),
    ):
        assert other.identity != one.identity
    assert one.described()["hash"] == one.identity
    assert one.described()["rule"]["kind"] == "distance"


def test_a_solid_at_the_border_is_closed_there_and_said_to_be():
    with pytest.warns(PalpateWarning, match=r"border at first i \(\d+ voxels\), last k \(\d+ voxels\); it is closed"):
        thing = balled(ball()[11:, :, :12])
    assert trimesh.Trimesh(*thing.outline_mesh(), process=False).is_watertight


def test_threads_share_one_upload():
    thing = balled()
    fields = []
    threads = [threading.Thread(target=lambda: fields.append(thing.field_on("cpu"))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({id(field) for field in fields}) == 1


def with_bad_voxel(value):
    out = ball()
    out[3, 4, 5] = value
    return out


REFUSED = {
    "a slice": (np.zeros((5, 4)), {}, r"values\[:, :, None\]"),
    "a time series": (np.zeros((5, 4, 3, 2)), {}, "of a time series or of channels, choose one"),
    "text": (np.full((3, 3, 3), "a"), {}, "bool, integer or float, not <U1"),
    "NaN": (with_bad_voxel(np.nan), {}, r"1 voxels are not finite, the first is voxel \[3, 4, 5\]: nan"),
    "spacing 0": (None, {"spacing": (0.01, 0, 0.01)}, r"positive lengths in metres, not \(0.01, 0, 0.01\)"),
    "origin": (None, {"origin": (0, np.inf, 0)}, "origin must be three finite"),
    "flat direction": (None, {"direction": TURNED[:, [0, 1, 1]]}, "must not lie in a plane"),
    "both": (None, {"affine": np.eye(4)}, "not both"),
    "singular affine": (None, {"spacing": None, "affine": np.diag([1, 1, 0, 1])}, "must not lie in a plane"),
    "unknown kind": (None, {"kind": "sdf"}, "occupancy, distance, intensity, label, not 'sdf'"),
    "no kind": (None, {"kind": None}, "say kind='distance'"),
    "no level": (None, {"kind": "intensity"}, "need a level between -0.02"),
    "label of a distance": (None, {"label": 1}, "do not go together"),
    "inside": (None, {"inside": "left"}, "'below' or 'above' the level, not 'left'"),
    "smooth distance": (None, {"smooth": 0.01}, "smooth is for occupancy"),
    "occupancy of 2": (2 * (ball() < 0), {"kind": "occupancy"}, "must be 0 or 1, but layer 4 has 2"),
    "missing label": (
        np.arange(27).reshape(3, 3, 3),
        {"kind": None, "label": (3, 40)},
        "label 40 .* has 0, 1, 2, .*, ...",
    ),
    "constant": (np.ones((4, 4, 4)), {"kind": None, "level": 1.0}, "no voxel is inside .above level 1; .* 1 to 1"),
    "all inside": (np.ones((4, 4, 4), bool), {"kind": None}, "all 64 voxels are inside"),
    "masked": (np.ma.masked_less(ball(), 0), {}, r"^\d+ voxels are masked: give them values"),
    "spacing 1e-310": (None, {"spacing": 1e-310}, r"must be 1e-09..1e\+06 m apart"),
    "level of text": (None, {"level": "x"}, "level must be finite, not 'x'"),
    "label 1.9": (ball() < 0, {"kind": None, "label": 1.9}, "label must be a whole number, or several, not 1.9"),
    "huge smooth": (ball() < 0, {"kind": None, "smooth": 1e9}, "smooth of 1e[+]09 m is wider than the volume"),
    "too large": (np.full((3, 3, 3), 1e300), {"kind": None, "level": 0.0}, "too large for float32"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_volume_is_refused_in_one_sentence(case):
    values, options, message = REFUSED[case]
    with pytest.raises(VoxelError, match=message) as caught:
        balled(values, **options)
    assert isinstance(caught.value, MeshError)
    assert "\n" not in str(caught.value)
