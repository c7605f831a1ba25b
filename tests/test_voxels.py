"""Volumes as objects: what values mean, where they lie, files of every kind, and what is refused in one sentence."""

import importlib.util
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import trimesh
import warp as wp
from field_points import values_at

from palpate.render import MeshObject, Placement
from palpate.render.errors import MeshError, PalpateWarning, PlacementError, VoxelError
from palpate.render.solid import Solid
from palpate.render.voxel_files import is_volume, read_volume, save_voxels
from palpate.render.voxels import VoxelObject

TURNED = np.array([[0.0, -0.8, 0.6], [1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
PLACE = Placement(at=(0.0, 0.0, 0.2))


def coordinates(shape):
    return np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij"), axis=-1)


def ball(shape=(22, 20, 24), spacing=(0.004, 0.005, 0.003), radius=0.03):
    """Signed distance to a ball in the middle [m], with the spacing."""
    at = (coordinates(shape) - (np.array(shape) - 1) / 2) * spacing
    return (np.linalg.norm(at, axis=-1) - radius).astype(np.float32)


def balled(values=None, **options):
    options = {"spacing": (0.004, 0.005, 0.003), "placement": PLACE, "kind": "distance", **options}
    return VoxelObject(ball() if values is None else values, **options)


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
        balled(labels.astype(np.float32), kind="label", label=[9, 7]),
        balled(-distance, inside="above"),
        balled(100 - 1e3 * distance, kind=None, level=100.0),
        balled(1e3 * distance, kind="intensity", level=0.0, inside="below"),
        balled(distance + 0.5, level=0.5),
        balled(distance.astype(">f8")),
        balled(np.asfortranarray(distance)),
    ):
        np.testing.assert_array_equal(thing.values < 0, inside)
        assert thing.inside_count == inside.sum()


def test_a_binary_ball_is_within_a_voxel_and_a_half_and_smoothing_brings_it_closer():
    plain = balled(ball() < 0, kind=None)
    smooth = balled(ball() < 0, kind=None, smooth=0.004)
    assert surface_distances(plain).max() < 1.5 * 0.003
    assert np.std(surface_distances(smooth)) < 0.6 * np.std(surface_distances(plain))


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


def test_bounds_hold_the_surface_and_are_tight_along_the_axes(rng):
    for matrix, slack in ((np.diag([0.004, 0.005, 0.003]), 1e-8), (TURNED * [0.004, 0.005, 0.003], 0.009)):
        affine = np.eye(4)
        affine[:3, :3], affine[2, 3] = matrix, 0.2
        values = rng.normal(size=(9, 9, 9))
        values[[0, -1]] = values[:, [0, -1]] = values[:, :, [0, -1]] = 1.0
        thing = VoxelObject(values, affine=affine, kind="distance")
        vertices = thing.outline_mesh()[0]
        low, high = vertices.min(axis=0) - thing.bounds[0], thing.bounds[1] - vertices.max(axis=0)
        assert min(low.min(), high.min()) >= -1e-8
        assert max(low.max(), high.max()) <= slack


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


def test_a_fit_needs_no_spacing_and_nothing_else_can_be_left_out():
    thing = VoxelObject(ball() < 0, placement=Placement(fit=0.1, at=(0, 0, 0.2)))
    assert np.ptp(thing.bounds, axis=0).max() == pytest.approx(0.1)
    with pytest.raises(VoxelError, match="spacing must be given"):
        VoxelObject(ball() < 0)


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


def test_places_that_look_wrong_are_warned_of():
    with pytest.warns(PalpateWarning, match="give the unit"):
        balled(spacing=(4.0, 5.0, 3.0), placement=Placement(at=(0, 0, 100.0)))
    with pytest.warns(PalpateWarning, match="behind the array"):
        balled(placement=Placement(at=(0, 0, 0.0)))


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
    "no axes": (np.float32(1.0), {}, r"\[i, j, k\], not \[\]"),
    "a line": (np.zeros(5), {}, r"\[i, j, k\], not \[5\]"),
    "a slice": (np.zeros((5, 4)), {}, r"values\[:, :, None\]"),
    "a time series": (np.zeros((5, 4, 3, 2)), {}, "of a time series or of channels, choose one"),
    "empty": (np.zeros((5, 0, 3)), {}, r"empty: shape \[5, 0, 3\]"),
    "complex": (np.zeros((3, 3, 3), complex), {}, "complex128"),
    "text": (np.full((3, 3, 3), "a"), {}, "bool, integer or float, not <U1"),
    "objects": (np.full((3, 3, 3), None), {}, "not object"),
    "NaN": (with_bad_voxel(np.nan), {}, r"1 voxels are not finite, the first is voxel \[3, 4, 5\]: nan"),
    "infinite": (with_bad_voxel(-np.inf), {}, r"\[3, 4, 5\]: -inf"),
    "spacing 0": (None, {"spacing": (0.01, 0, 0.01)}, r"positive lengths in metres, not \(0.01, 0, 0.01\)"),
    "negative spacing": (None, {"spacing": -0.01}, "not -0.01"),
    "spacing NaN": (None, {"spacing": np.nan}, "not nan"),
    "two spacings": (None, {"spacing": (0.01, 0.01)}, "one or three"),
    "origin": (None, {"origin": (0, np.inf, 0)}, "origin must be three finite"),
    "flat direction": (None, {"direction": TURNED[:, [0, 1, 1]]}, "must not lie in a plane"),
    "direction of length 2": (None, {"direction": 2 * TURNED}, "columns of length 1"),
    "both": (None, {"affine": np.eye(4)}, "not both"),
    "singular affine": (None, {"spacing": None, "affine": np.diag([1, 1, 0, 1])}, "must not lie in a plane"),
    "projective affine": (None, {"spacing": None, "affine": np.ones((4, 4))}, "end in 0 0 0 1"),
    "affine 3 x 4": (None, {"spacing": None, "affine": np.eye(4)[:3]}, r"\[4, 4\]"),
    "unknown kind": (None, {"kind": "sdf"}, "occupancy, distance, intensity, label, not 'sdf'"),
    "no kind": (None, {"kind": None}, "say kind='distance'"),
    "no level": (None, {"kind": "intensity"}, "need a level between -0.02"),
    "level NaN": (None, {"level": np.nan}, "level must be finite"),
    "level of occupancy": (ball() < 0, {"kind": None, "level": 0.5, "label": 1}, "level and inside are for"),
    "label of a distance": (None, {"label": 1}, "do not go together"),
    "inside": (None, {"inside": "left"}, "'below' or 'above' the level, not 'left'"),
    "smooth distance": (None, {"smooth": 0.01}, "smooth is for occupancy"),
    "negative smooth": (ball() < 0, {"kind": None, "smooth": -1.0}, "smooth must be"),
    "occupancy of 2": (2 * (ball() < 0), {"kind": "occupancy"}, "must be 0 or 1, but layer 4 has 2"),
    "missing label": (
        np.arange(27).reshape(3, 3, 3),
        {"kind": None, "label": (3, 40)},
        "label 40 .* has 0, 1, 2, .*, ...",
    ),
    "constant": (np.ones((4, 4, 4)), {"kind": None, "level": 1.0}, "no voxel is inside .above level 1; .* 1 to 1"),
    "level too high": (None, {"kind": "intensity", "level": 9.0}, "no voxel is inside"),
    "all inside": (np.ones((4, 4, 4), bool), {"kind": None}, "all 64 voxels are inside"),
    "too large": (np.full((3, 3, 3), 1e300), {"kind": None, "level": 0.0}, "too large for float32"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_volume_is_refused_in_one_sentence(case):
    values, options, message = REFUSED[case]
    with pytest.raises(VoxelError, match=message) as caught:
        balled(values, **options)
    assert isinstance(caught.value, MeshError)
    assert "\n" not in str(caught.value)


def test_placements_are_refused_as_for_meshes():
    with pytest.raises(PlacementError, match="scale"):
        balled(placement=Placement(scale=-1.0))
    with pytest.raises(VoxelError, match="overflow"):
        balled(placement=Placement(scale=1e300))


def skipped_unless(module):
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed")


FORMATS = {".npz": None, ".nrrd": "nrrd", ".nii": "nibabel", ".nii.gz": "nibabel", ".nvdb": None}


@pytest.mark.parametrize("end", FORMATS)
@pytest.mark.parametrize("kind", ["distance", "occupancy"])
def test_what_is_saved_is_loaded_again(end, kind, tmp_path, rng, device):
    if FORMATS[end]:
        skipped_unless(FORMATS[end])
    placement = PLACE if end == ".nvdb" else Placement(at=(0, 0, 0.2), rotate=(10, 20, 30))
    thing = balled(ball() if kind == "distance" else ball() < 0, kind=kind, placement=placement)
    path = tmp_path / f"ball{end}"
    path.write_bytes(b"what was there before")
    save_voxels(thing, path)
    said = None if end in (".npz", ".nvdb") or kind == "occupancy" else kind
    again = VoxelObject.load(path, kind=said)
    points = rng.uniform(*thing.bounds, size=(400, 3))
    one, two = (values_at(x.field_on(device), points, device) for x in (thing, again))
    np.testing.assert_allclose(two, one, atol=1e-5 if kind == "occupancy" else 1e-7)
    np.testing.assert_allclose(again.bounds, thing.bounds, atol=2e-8)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert is_volume(path)


@pytest.mark.parametrize("end", [*FORMATS, ".npy"])
def test_a_file_cut_short_is_refused_in_one_sentence(end, tmp_path):
    if FORMATS.get(end):
        skipped_unless(FORMATS[end])
    path = tmp_path / f"cut{end}"
    if end == ".npy":
        np.save(path, ball())
    else:
        save_voxels(balled(), path)
    whole = path.read_bytes()
    for length in (0, 3, 20, 100, len(whole) // 2, len(whole) - 40):
        path.write_bytes(whole[:length])
        with pytest.raises(VoxelError, match=r"cut\.\S+: (cannot be read as a volume|holds|has)") as caught:
            VoxelObject.load(path, kind="distance", spacing=0.01)
        assert "\n" not in str(caught.value)


def test_numpy_files_without_a_grid_or_values_are_named(tmp_path):
    np.save(tmp_path / "a.npy", ball() < 0)
    with pytest.raises(VoxelError, match=r"a\.npy: spacing must be given"):
        VoxelObject.load(tmp_path / "a.npy")
    thing = VoxelObject.load(tmp_path / "a.npy", spacing=0.004, placement=PLACE)
    np.testing.assert_allclose(thing.spacing, 0.004)
    np.savez(tmp_path / "b.npz", value=ball())
    with pytest.raises(VoxelError, match=r"has no array 'values' \(but value\)"):
        VoxelObject.load(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", values=ball() < 0, spacing=[4.0, 5.0, 3.0], origin=[0, 0, 100.0], direction=TURNED)
    thing = VoxelObject.load(tmp_path / "c.npz", unit="mm")
    np.testing.assert_allclose(thing.affine[:3, :3], TURNED * [0.004, 0.005, 0.003], atol=1e-12)
    np.testing.assert_allclose(thing.affine[:3, 3], [0, 0, 0.1])
    np.savez(tmp_path / "f.npz", values=100 - 1e3 * ball(), spacing=0.004, kind="intensity", level=100.0)
    thing = VoxelObject.load(tmp_path / "f.npz", placement=PLACE)
    np.testing.assert_array_equal(thing.values < 0, ball() < 0)
    assert VoxelObject.load(tmp_path / "f.npz", level=98.0, placement=PLACE).inside_count > thing.inside_count
    np.save(tmp_path / "d.npy", np.full((3, 3, 3), None), allow_pickle=True)
    with pytest.raises(VoxelError, match="Python objects"):
        VoxelObject.load(tmp_path / "d.npy", spacing=0.01)
    np.savez(tmp_path / "e.npz", values=np.full((3, 3, 3), None), spacing=0.01)
    with pytest.raises(VoxelError, match=r"e\.npz: cannot be read"):
        VoxelObject.load(tmp_path / "e.npz")


def test_names_and_units_that_are_none_are_refused(tmp_path):
    for name, message in (
        ("a.vti", "is no volume by its name"),
        ("a.vdb", "nanovdb_convert"),
        ("missing.npz", r"missing\.npz: no such file"),
    ):
        with pytest.raises(VoxelError, match=message):
            VoxelObject.load(tmp_path / name)
    with pytest.raises(VoxelError, match="unit must be one of m, cm, mm, um, not 'inch'"):
        VoxelObject.load(tmp_path / "a.npz", unit="inch")
    with pytest.raises(VoxelError, match=r"written to \.npz, "):
        save_voxels(balled(), tmp_path / "a.stl")
    with pytest.raises(VoxelError, match=r"b\.npz: cannot be written"):
        save_voxels(balled(), tmp_path / "nowhere" / "b.npz")
    with pytest.warns(PalpateWarning, match="no spacing"):
        save_voxels(balled(), tmp_path / "c.npy")
    with pytest.raises(VoxelError, match="turned or mirrored"):
        save_voxels(balled(placement=Placement(rotate=(1, 2, 3), at=(0, 0, 0.2))), tmp_path / "c.nvdb")


@pytest.mark.parametrize(("end", "module", "package"), [(".nrrd", "nrrd", "pynrrd"), (".nii", "nibabel", "nibabel")])
def test_a_missing_reader_is_named_with_the_command_that_brings_it(end, module, package, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / f"a{end}").write_bytes(b"anything")
    with pytest.raises(VoxelError, match=f"pip install {package}"):
        VoxelObject.load(tmp_path / f"a{end}")


def test_nrrd_spaces_and_units_are_those_of_nifti(tmp_path):
    nrrd = pytest.importorskip("nrrd")
    values = (ball() < 0).astype(np.uint8)
    rows = (TURNED * [4.0, 5.0, 3.0]).T  # [mm]
    flips = {"right-anterior-superior": (1, 1, 1), "left-posterior-superior": (-1, -1, 1), "LAS": (-1, 1, 1)}
    for space, flip in flips.items():
        for unit, scale in (("mm", 1.0), ("cm", 0.1), (None, 1.0)):
            header = {"space": space, "space directions": rows * flip * scale}
            header["space origin"] = np.array([10.0, 20.0, 200.0]) * flip * scale
            if unit:
                header["space units"] = [unit] * 3
            nrrd.write(str(tmp_path / "a.nrrd"), values, header)
            volume = read_volume(tmp_path / "a.nrrd")
            np.testing.assert_allclose(volume.affine[:3, :3], TURNED * [0.004, 0.005, 0.003], atol=1e-12)
            np.testing.assert_allclose(volume.affine[:3, 3], [0.01, 0.02, 0.2], atol=1e-12)
    nrrd.write(str(tmp_path / "b.nrrd"), values, {"spacings": [4.0, 5.0, 3.0]})
    np.testing.assert_allclose(read_volume(tmp_path / "b.nrrd").affine, np.diag([0.004, 0.005, 0.003, 1.0]))
    nrrd.write(str(tmp_path / "c.nhdr"), values, {"spacings": [4.0, 5.0, 3.0]}, detached_header=True)
    np.testing.assert_array_equal(read_volume(tmp_path / "c.nhdr").values, values)
    header = {"space": "right-anterior-superior", "space directions": rows, "space units": ["inch"] * 3}
    nrrd.write(str(tmp_path / "d.nrrd"), values, header)
    with pytest.raises(VoxelError, match="space units inch are not known"):
        read_volume(tmp_path / "d.nrrd")
    assert read_volume(tmp_path / "d.nrrd", "cm").affine is not None


def test_nifti_of_four_axes_or_other_units(tmp_path):
    nibabel = pytest.importorskip("nibabel")
    values = (ball() < 0).astype(np.uint8)
    affine = np.diag([0.4, 0.5, 0.3, 1.0])
    for shape in ((*values.shape, 1), (*values.shape, 1, 1)):
        image = nibabel.Nifti1Image(values.reshape(shape), affine)
        image.header.set_xyzt_units("meter")
        nibabel.save(image, tmp_path / "a.nii")
        volume = read_volume(tmp_path / "a.nii")
        np.testing.assert_array_equal(volume.values, values)
        np.testing.assert_allclose(volume.affine, affine, atol=1e-7)
    nibabel.save(nibabel.Nifti1Image(np.stack([values] * 3, axis=-1), affine), tmp_path / "b.nii")
    with pytest.raises(VoxelError, match=r"not \[22, 20, 24, 3\]: of a time series"):
        VoxelObject.load(tmp_path / "b.nii")


def test_nanovdb_of_another_type_or_too_large_is_refused(tmp_path, monkeypatch):
    for name, fill in (("int", 1), ("vector", (1.0, 0.0, 0.0))):
        shape = (9, 9, 9) if name == "int" else (9, 9, 9, 3)
        volume = wp.Volume.load_from_numpy(np.ones(shape, np.float32), bg_value=fill, device="cpu")
        volume.save_to_nvdb(str(tmp_path / f"{name}.nvdb"))
        with pytest.raises(VoxelError, match="float is needed"):
            VoxelObject.load(tmp_path / f"{name}.nvdb")
    save_voxels(balled(), tmp_path / "ball.nvdb")
    monkeypatch.setattr("palpate.render.voxel_files.VOXELS_MOST", 1000)
    with pytest.raises(VoxelError, match="may have 1000 voxels, not"):
        VoxelObject.load(tmp_path / "ball.nvdb")


def test_a_real_level_set_is_loaded_from_warps_wheel():
    path = Path(wp.__file__).parent / "examples" / "assets" / "rocks.nvdb"
    if not path.is_file():
        pytest.skip("this Warp has no rocks.nvdb")
    thing = VoxelObject.load(path, placement=Placement(fit=0.13, at=(0, 0, 0.2)))
    assert thing.rule.kind == "distance"
    assert np.ptp(thing.bounds, axis=0).max() == pytest.approx(0.13)
    np.testing.assert_allclose(thing.bounds.mean(axis=0), [0, 0, 0.2], atol=1e-9)
    volume = wp.Volume.load_from_nvdb(path.read_bytes(), device="cpu")
    assert thing.values.max() == pytest.approx(0.6)  # background, +- three voxels of 0.2
    assert thing.values.min() == pytest.approx(-0.6)
    assert thing.inside_count == 508283
    assert volume.get_voxel_count() > 0
    mesh = trimesh.Trimesh(*thing.outline_mesh(), process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(thing.inside_count * np.prod(thing.spacing), rel=0.01)


def test_a_real_medical_volume_is_loaded_from_nibabels_wheel():
    nibabel = pytest.importorskip("nibabel")
    path = Path(nibabel.__file__).parent / "tests" / "data" / "anatomical.nii"
    if not path.is_file():
        pytest.skip("this nibabel has no test data")
    with pytest.warns(PalpateWarning, match="reaches the volume's border"):
        thing = VoxelObject.load(path, level=5000.0, placement=PLACE)
    assert thing.values.shape == (33, 41, 25)
    size = abs(np.linalg.det(nibabel.load(path).affine[:3, :3]))  # [mm^3]
    assert abs(np.linalg.det(thing.affine[:3, :3])) == pytest.approx(size * 1e-9)


def test_a_real_segmented_brain_is_loaded_from_nilearns_wheel():
    skipped_unless("nibabel")
    spec = importlib.util.find_spec("nilearn")  # its data only: importing it takes seconds
    if spec is None:
        pytest.skip("nilearn is not installed")
    path = Path(spec.origin).parent / "datasets" / "data" / "mni_icbm152_wm_tal_nlin_sym_09a_converted.nii.gz"
    thing = VoxelObject.load(path, level=128.0, placement=Placement(fit=0.13, at=(0, 0, 0.2)))
    assert 500_000 < thing.inside_count < 800_000  # [mm^3] of white matter
    assert trimesh.Trimesh(*thing.outline_mesh(), process=False).is_watertight
