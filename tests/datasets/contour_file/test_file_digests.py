"""Digests prove what Fletcher-32 cannot; the outside truth is XXH3, by the xxhash library, of what h5py reads."""

import json

import h5py
import numpy as np
import pytest
from contour_cases import (
    assert_same,
    content_digests,
    everything,
    make_contours,
    make_header,
    make_metrics,
    redigest,
    small_chunks,
    write_file,
    write_ranges,
)

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError
from palpate.datasets.storage.schema import FIELDS


@pytest.fixture
def contours():
    return make_contours(30, intensity=True, dwell=True)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The bytes of a sealed file."""
    path = tmp_path_factory.mktemp("whole") / "out.h5"
    with small_chunks():
        write_file(path, make_contours(30, intensity=True, dwell=True), chunk=11, **everything(30))
    return path.read_bytes()


@pytest.fixture
def sealed(tmp_path, whole):
    (tmp_path / "out.h5").write_bytes(whole)
    return tmp_path / "out.h5"


def test_digests_are_those_of_the_documented_bytes(sealed):
    """`redigest` follows docs/formats/file-format.md with h5py and xxhash alone."""
    with h5py.File(sealed) as file:
        before, blocks = json.loads(file.attrs["digests"]), file["/digests/block"][...]
    redigest(sealed)
    with h5py.File(sealed) as file:
        assert json.loads(file.attrs["digests"]) == before
        np.testing.assert_array_equal(file["/digests/block"][...], blocks)
    assert set(before["datasets"]) == {spec.path for spec in FIELDS}


@pytest.mark.exhaustive
@pytest.mark.parametrize("gzip", [0, 1])
def test_blocks_and_poses_held_in_any_order_are_sealed_to_the_content_of_one_write(tmp_path, contours, sealed, gzip):
    for name, committed, held in (
        ("none held", [(11, 30), (0, 11)], []),
        ("held last", [(0, 11)], [(20, 30), (11, 20)]),
        ("held between", [(20, 30), (0, 3)], [(3, 20)]),
        ("held around", [(11, 20)], [(20, 30), (0, 11)]),
        ("all held", [], [(0, 30)]),
    ):
        path = tmp_path / name
        with small_chunks(), ContourWriter(path, make_header(30, **everything(30))) as writer:
            write_ranges(writer, contours, committed)
            write_ranges(writer, contours, held, held=True)
            writer.seal(gzip=gzip)
        assert check_file(path) == []
        assert content_digests(path) == content_digests(sealed)


def read_all(file):
    return file.contours(), file.metrics(), file.header(), file.timing()


HAVE_ZEROS = [spec for spec in FIELDS if spec.name in ("polyline_start", "pose_start", "faces", "vertices")]


@pytest.mark.exhaustive(after=2)
@pytest.mark.parametrize(
    ("damage", "spec"),
    [
        *((name, spec) for spec in FIELDS for name in ("zeros", "a bit")),
        *(("other zeros", spec) for spec in HAVE_ZEROS),
    ],
    ids=lambda value: getattr(value, "path", value),
)
def test_damage_that_fletcher_32_finds_or_not_is_refused_by_the_name_of_the_dataset(sealed, contours, spec, damage):
    """A chunk of zeros has the checksum 0, and 0xFFFF counts as 0x0000."""
    with h5py.File(sealed) as file:
        chunk = file[spec.path].id.get_chunk_info(0)
    content = bytearray(sealed.read_bytes())
    begin, end = chunk.byte_offset, chunk.byte_offset + chunk.size
    if damage == "zeros":
        content[begin:end] = bytes(end - begin)
    elif damage == "a bit":
        content[(begin + end) // 2] ^= 0x10
    else:
        words = np.frombuffer(bytes(content[begin : end - 4 - chunk.size % 2]), "<u2").copy()
        assert (words == 0).any()
        words[words == 0] = 0xFFFF
        content[begin : begin + words.nbytes] = words.tobytes()
    assert bytes(content) != sealed.read_bytes()
    sealed.write_bytes(content)
    problems = check_file(sealed)
    said = f"{spec.path} is damaged: the checksum" if damage == "a bit" else "not what was written"
    assert any(spec.path in problem and said in problem for problem in problems), problems
    with ContourFile(sealed) as file, pytest.raises(ContourFileError, match=f"{spec.path} is damaged"):
        read_all(file)
    with pytest.raises(ContourFileError, match=f"{spec.path} is damaged"):
        ContourFile(sealed, verify=True)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("group", "key"), [("/", "strategy"), ("/", "created"), ("/object", "name"), ("/motion", "offset")]
)
def test_an_attribute_that_was_changed_is_found(sealed, group, key):
    with h5py.File(sealed, "r+") as file:
        value = file[group].attrs[key]
        file[group].attrs.modify(key, b"{}" if isinstance(value, bytes) else value + 1.0)
    message = f"attribute {key} of {group} is not what was written"
    assert any(message in problem for problem in check_file(sealed))
    with pytest.raises(ContourFileError, match=message):
        ContourFile(sealed, verify=True)


def test_digests_that_were_zeroed_are_found(sealed):
    with h5py.File(sealed, "r+") as file:
        file["/digests/block"][...] = 0
    with (
        ContourFile(sealed) as file,
        pytest.raises(ContourFileError, match="the digests of /contours/pose_start are not"),
    ):
        file.contours()


def test_a_file_without_digests_is_read_if_it_is_older_than_they(sealed, contours):
    with h5py.File(sealed, "r+") as file:
        del file.attrs["digests"]
        del file["/digests"]
    with pytest.raises(ContourFileError, match=r"attribute digests of / is missing, which format 1\.4 has"):
        ContourFile(sealed)
    with h5py.File(sealed, "r+") as file:
        file.attrs["version"] = np.array([1, 1], np.int32)
    with ContourFile(sealed) as file:
        assert_same(file.contours(), contours)
        with pytest.raises(ContourFileError, match="has no digests that prove its content"):
            file.require_whole()


def test_digests_that_are_none_are_refused(sealed):
    for broken in (
        "[]",
        "{",
        '{"block_rows": 0, "datasets": {}, "attributes": {}}',
        '{"block_rows": 1, "datasets": {}, "attributes": {"/": "x"}}',
        "[" * 50_000,
    ):
        with h5py.File(sealed, "r+") as file:
            file.attrs["digests"] = np.array(broken.encode(), h5py.string_dtype("utf-8", len(broken)))
        with pytest.raises(ContourFileError, match="digests of / is damaged"):
            ContourFile(sealed)


def zero_a_chunk(block):
    with h5py.File(block) as file:
        chunk = file["/contours/points"].id.get_chunk_info(0)
    content = bytearray(block.read_bytes())
    content[chunk.byte_offset : chunk.byte_offset + chunk.size] = bytes(chunk.size)
    block.write_bytes(content)


@pytest.mark.exhaustive
def test_sealing_refuses_a_chunk_of_zeros_and_resuming_renders_it_again(tmp_path, contours):
    path = tmp_path / "out.h5"
    block = tmp_path / "out.h5.partial" / "poses-000000000010-000000000020.h5"
    with small_chunks():
        with ContourWriter(path, make_header(30)) as writer:
            write_ranges(writer, contours, [(0, 10), (10, 20), (20, 30)])
            zero_a_chunk(block)
            with ContourFile(path) as file, pytest.raises(ContourFileError, match="points is damaged"):
                file.contours()
            with pytest.raises(ContourFileError, match=f"{block.name}.* rows 0 to 7 are not what was written"):
                writer.seal()
        assert not path.exists()
        with ContourWriter(path, make_header(30), mode="resume") as writer:
            assert writer.missing() == [(10, 20)]
            assert len(writer.repairs) == 1
            write_ranges(writer, contours, writer.missing())
            writer.seal()
    with ContourFile(path, verify=True) as file:
        assert_same(file.contours(), contours)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("size", [10_000, 60_000, 3_000_000])
def test_texts_of_any_length_are_sealed(tmp_path, contours, size):
    """Texts of 41 to 65 kB could never be sealed; longer ones HDF5 keeps elsewhere."""
    path = tmp_path / "out.h5"
    header = make_header(30, strategy={"raw": "mesh", "note": "x" * size}, hand={"kind": "palm", "note": "y" * size})
    with ContourWriter(path, header) as writer:
        write_ranges(writer, contours, [(0, 30)])
        writer.seal()
    assert check_file(path) == []
    with ContourFile(path, verify=True) as file:
        assert file.strategy["note"] == "x" * size
        assert_same(file.contours(), contours)


def test_a_long_list_of_stages_is_sealed(tmp_path, contours):
    path = tmp_path / "out.h5"
    stages = {f"stage {k} {'x' * 200}": 0.5 for k in range(200)}
    with ContourWriter(path, make_header(30)) as writer:
        writer.write(0, 30, contours, make_metrics(contours), stages)
        writer.seal()
    assert check_file(path) == []
    with ContourFile(path, verify=True) as file:
        assert file.timing().stages == list(stages)
