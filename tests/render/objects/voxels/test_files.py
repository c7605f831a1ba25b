"""Volumes from files of every kind and into them: what comes back, and what is refused in one sentence."""

import gzip
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
import warp as wp
from field_points import values_at
from voxel_cases import PLACE, TURNED, ball, balled, skipped_unless

from palpate.datasets.bounded_file import unpack
from palpate.render import Placement
from palpate.render.errors import PalpateWarning, VoxelError
from palpate.render.objects.voxels import files
from palpate.render.objects.voxels.files import is_volume, read_volume, without_lists
from palpate.render.objects.voxels.voxel_object import VoxelObject, save_voxels

FORMATS = {".npz": None, ".nrrd": "nrrd", ".nii": "nibabel", ".nii.gz": "nibabel", ".nvdb": None}


@pytest.mark.exhaustive
@pytest.mark.parametrize("end", FORMATS)
@pytest.mark.parametrize("kind", ["distance", "occupancy"])
def test_what_is_saved_is_loaded_again(end, kind, tmp_path, rng, device):
    if FORMATS[end]:
        skipped_unless(FORMATS[end])
    placement = PLACE if end == ".nvdb" else Placement(at=(0, 0, 0.2), rotate=(10, 20, 30))
    thing = balled(ball() if kind == "distance" else ball() < 0, kind=kind, placement=placement)
    path = tmp_path / f"ball{end}"
    path.write_bytes(b"what was there before")
    with pytest.raises(VoxelError, match="exists; overwrite=True"):
        save_voxels(thing, path)
    assert path.read_bytes() == b"what was there before"
    save_voxels(thing, path, overwrite=True)
    said = None if end in (".npz", ".nvdb") or kind == "occupancy" else kind
    again = VoxelObject.load(path, kind=said)
    points = rng.uniform(*thing.bounds, size=(400, 3))
    one, two = (values_at(x.field_on(device), points, device) for x in (thing, again))
    np.testing.assert_allclose(two, one, atol=1e-5 if kind == "occupancy" else 1e-7)
    np.testing.assert_allclose(again.bounds, thing.bounds, atol=2e-8)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert is_volume(path)


@pytest.mark.exhaustive(after=1)
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
    header = {"spacings": [0.4, 5.0, 3000.0], "units": ["cm", "mm", "um"]}
    nrrd.write(str(tmp_path / "b.nrrd"), values, header)
    np.testing.assert_allclose(read_volume(tmp_path / "b.nrrd").affine, np.diag([0.004, 0.005, 0.003, 1.0]))
    for spacings in ([-4.0, 5.0, 3.0], [np.nan, 5.0, 3.0], [0.0, 5.0, 3.0]):
        nrrd.write(str(tmp_path / "b.nrrd"), values, {"spacings": spacings})
        with pytest.raises(VoxelError, match=r"b\.nrrd: spacing must be one or three positive lengths"):
            read_volume(tmp_path / "b.nrrd")
    nrrd.write(str(tmp_path / "c.nhdr"), values, {"spacings": [4.0, 5.0, 3.0]}, detached_header=True)
    np.testing.assert_array_equal(read_volume(tmp_path / "c.nhdr").values, values)
    header = {"space": "right-anterior-superior", "space directions": rows, "space units": ["inch"] * 3}
    nrrd.write(str(tmp_path / "d.nrrd"), values, header)
    with pytest.raises(VoxelError, match="space units inch are not known"):
        read_volume(tmp_path / "d.nrrd")
    assert read_volume(tmp_path / "d.nrrd", "cm").affine is not None


SKIPS = {  # what is before the data, as the format's definition says: lines first, then bytes, once unpacked
    "raw": [(b"a\nb\n", b"", "line skip: 2\n"), (b"a\n", b"xyz", "line skip: 1\nbyte skip: 3\n")],
    "gzip": [(b"a\nb\n", b"xyz", "lineskip: 2\nbyteskip: 3\n"), (b"a\n", b"x" * 99, "line skip: 1\nbyte skip: -1\n")],
    "text": [(b"a 1\nb 2\n", b"", "line skip: 2\n")],
}
SKIPS["raw"].append((b"a\n", b"x\n" * 99, "line skip: 1\nbyte skip: -1\n"))


@pytest.mark.parametrize(("encoding", "lines", "leading", "fields"), [(k, *v) for k in SKIPS for v in SKIPS[k]])
def test_nrrd_skips_lines_and_then_bytes(encoding, lines, leading, fields, tmp_path):
    pytest.importorskip("nrrd")
    values = np.arange(27, dtype=np.uint8).reshape(3, 3, 3)
    held = b" ".join(b"%d" % x for x in values.ravel()) if encoding == "text" else leading + values.tobytes()
    data = lines + (gzip.compress(held) if encoding == "gzip" else held)
    header = f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 3 3 3\nencoding: {encoding}\n"
    (tmp_path / "a.nrrd").write_bytes(f"{header}{fields}\n".encode() + data)
    np.testing.assert_array_equal(read_volume(tmp_path / "a.nrrd").values.T, values)


@pytest.mark.parametrize(("encoding", "count"), [("raw", -1), ("gzip", 4), ("text", 999_999_999_999)])
def test_nrrd_of_fewer_lines_than_are_skipped_is_refused_at_once(encoding, count, tmp_path, monkeypatch):
    nrrd = pytest.importorskip("nrrd")
    monkeypatch.setattr(nrrd, "read_data", lambda *given: pytest.fail("lines are skipped one by one"))
    header = f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 3 3 3\nencoding: {encoding}\nline skip: {count}\n\n"
    (tmp_path / "a.nrrd").write_bytes(header.encode() + b"1 2\n" * 3)
    with pytest.raises(VoxelError, match=f"line skip must be 0 to 3, as many lines as the data have, not {count}"):
        read_volume(tmp_path / "a.nrrd")


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


def test_nifti_without_a_place_is_read_by_method_1_of_the_standard(tmp_path):
    """NIfTI-1 (nifti1.h, METHOD 1): x, y and z are the indices times pixdim, x to the right; nibabel turns x over."""
    nibabel = pytest.importorskip("nibabel")
    values = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    for kind, name in ((nibabel.Nifti1Image, "a.nii"), (nibabel.Nifti2Image, "b.nii.gz")):
        image = kind(values, None)
        image.header.set_zooms((2.0, 3.0, 4.0))
        image.header.set_xyzt_units("mm")
        nibabel.save(image, tmp_path / name)
        assert nibabel.load(tmp_path / name).affine[0, 0] == -2
        volume = read_volume(tmp_path / name)
        np.testing.assert_array_equal(volume.values, values)
        np.testing.assert_allclose(volume.affine, np.diag([0.002, 0.003, 0.004, 1.0]), rtol=1e-12)


def test_a_packed_nifti_is_read_no_further_than_its_header_says(tmp_path, monkeypatch):
    """1 GiB of zeros behind the data of 24 bytes: refused when the first of them is unpacked."""
    nibabel = pytest.importorskip("nibabel")
    read = []

    def noted(content, codec, declared=None, begin=None):
        read.append(declared if begin is None else begin)
        return unpack(content, codec, declared, begin)

    whole = nibabel.Nifti1Image(np.arange(24, dtype=np.uint8).reshape(2, 3, 4), np.eye(4)).to_bytes()
    monkeypatch.setattr(files, "unpack", noted)
    (tmp_path / "a.nii.gz").write_bytes(gzip.compress(whole))
    assert read_volume(tmp_path / "a.nii.gz").values.ravel().tolist() == list(range(24))
    (tmp_path / "b.nii.gz").write_bytes(gzip.compress(whole + bytes(1 << 20)))
    with pytest.raises(VoxelError, match="takes more than the 376 bytes that are declared"):
        read_volume(tmp_path / "b.nii.gz")
    assert read == [540, 352 + 24] * 2


def test_nanovdb_of_another_type_or_too_large_is_refused(tmp_path, monkeypatch):
    for name, fill in (("int", 1), ("vector", (1.0, 0.0, 0.0))):
        shape = (9, 9, 9) if name == "int" else (9, 9, 9, 3)
        volume = wp.Volume.load_from_numpy(np.ones(shape, np.float32), bg_value=fill, device="cpu")
        volume.save_to_nvdb(str(tmp_path / f"{name}.nvdb"))
        with pytest.raises(VoxelError, match="float is needed"):
            VoxelObject.load(tmp_path / f"{name}.nvdb")
    save_voxels(balled(), tmp_path / "ball.nvdb")
    monkeypatch.setattr("palpate.render.objects.voxels.grid.PADDED_MOST", 1000)
    with pytest.raises(VoxelError, match="values must be 1000 at most"):
        VoxelObject.load(tmp_path / "ball.nvdb")


@pytest.mark.exhaustive
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


def layer(header, values, path):
    """Write a NRRD with pynrrd's fields."""
    pytest.importorskip("nrrd").write(str(path), values, header)
    return path


def test_nrrd_of_one_layer_is_its_layer(tmp_path):
    """A segmentation of 3D Slicer: first an axis of layers, without a direction; here with one layer."""
    values = np.arange(24, dtype=np.uint8).reshape(1, 2, 3, 4)
    directions = np.array([[np.nan] * 3, [2.0, 0, 0], [0, 3.0, 0], [0, 0, 4.0]])
    kinds = ["list", "domain", "domain", "domain"]
    header = {"space": "right-anterior-superior", "space directions": directions, "kinds": kinds}
    header["space origin"] = np.array([0.0, 0.0, 200.0])
    volume = read_volume(layer(header, values, tmp_path / "a.nrrd"))
    np.testing.assert_array_equal(volume.values, values[0])
    np.testing.assert_allclose(volume.affine[:3], [[0.002, 0, 0, 0], [0, 0.003, 0, 0], [0, 0, 0.004, 0.2]], rtol=1e-12)
    spaced = {"kinds": kinds, "spacings": [np.nan, 2.0, 3.0, 4.0], "units": ["", "mm", "mm", "mm"]}
    volume = read_volume(layer(spaced, values, tmp_path / "b.nrrd"))
    np.testing.assert_array_equal(volume.values, values[0])
    np.testing.assert_allclose(np.diag(volume.affine), [0.002, 0.003, 0.004, 1.0], rtol=1e-12)
    slab = {"space": "RAS", "space directions": directions[1:], "space origin": header["space origin"]}
    assert read_volume(layer(slab, values[0, :1], tmp_path / "c.nrrd")).values.shape == (1, 3, 4)
    with pytest.raises(VoxelError, match=r"not \[2, 2, 3, 4\].* choose one: VoxelObject\(values"):
        VoxelObject.load(layer(header, np.repeat(values, 2, axis=0), tmp_path / "d.nrrd"))


@pytest.mark.parametrize("field", ["spacings", "units", "kinds"])
def test_fields_without_an_entry_for_each_axis_are_named(field):
    with pytest.raises(VoxelError, match=f"{field} must have 4 entries, one for each axis"):
        without_lists(np.zeros((1, 2, 3, 4)), {field: ["a", "b", "c"]})
