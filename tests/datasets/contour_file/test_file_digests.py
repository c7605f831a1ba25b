"""Which damage is found when, and what digests prove; their outside truth is XXH3-64 by xxhash of what h5py reads."""

import json
import os
import shutil

import h5py
import numpy as np
import pytest
from contour_cases import (
    assert_same,
    everything,
    finish,
    first_chunk,
    flip_bit,
    make_contours,
    make_header,
    make_metrics,
    put_text,
    redigest,
    small_chunks,
    write_file,
    write_ranges,
    zero_chunk,
)

from palpate.datasets.contour_file.check import check_file, unproven_content
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError
from palpate.datasets.storage.schema import FIELDS

POSES = 12
CONTOURS = make_contours(POSES, seed=1, intensity=True, dwell=True)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The bytes of a sealed file with everything that the format names."""
    path = tmp_path_factory.mktemp("whole") / "out.h5"
    with small_chunks():
        write_file(path, CONTOURS, **everything(POSES))
    return path.read_bytes()


@pytest.fixture
def sealed(tmp_path, whole):
    (tmp_path / "out.h5").write_bytes(whole)
    return tmp_path / "out.h5"


def stored_digests(path):
    with h5py.File(path) as file:
        return json.loads(file.attrs["digests"])


def test_digests_are_those_of_the_documented_bytes(sealed):
    before = stored_digests(sealed)
    redigest(sealed)
    assert stored_digests(sealed) == before
    assert set(before["datasets"]) == {spec.path for spec in FIELDS}
    with h5py.File(sealed) as file:
        groups = {name: set(file[name].attrs) - {"digests"} for name in ("/", *(f"/{own}" for own in file))}
    assert {name: set(keys) for name, keys in before["attributes"].items()} == {k: v for k, v in groups.items() if v}


def bit_of_structure(path):
    flip_bit(path, path.read_bytes().index(b"OHDR") + 20)  # of the root's header, by its signature


def bit_of_rows(path):
    flip_bit(path, first_chunk(path, "/contours/points")[0] + 5)


def chunk_of_zeros(path):
    zero_chunk(path, "/contours/points")


def other_zeros(path):
    """Fletcher-32 takes 0xFFFF for 0x0000."""
    begin, end = first_chunk(path, "/metrics/polylines")
    content = bytearray(path.read_bytes())
    words = np.frombuffer(bytes(content[begin : end - 4]), "<u2").copy()
    words[words == 0] = 0xFFFF
    content[begin : end - 4] = words.tobytes()
    path.write_bytes(content)


def truncation(path):
    os.truncate(path, path.stat().st_size - 1)


def missing_rows(path):
    with h5py.File(path, "r+") as file:
        old = file["/contours/points"]
        shape, attributes = old.shape, dict(old.attrs)
        del file["/contours/points"]
        made = file.create_dataset("/contours/points", shape, "<f4", chunks=(7, 3), fletcher32=True)
        made.attrs.update(attributes)


def an_attribute(path):
    with h5py.File(path, "r+") as file:
        put_text(file["/timing"], "stages", '{"stages": ["row"]}')


FOUND = {
    bit_of_structure: ("read", "check", "verify", "resume", "seal"),
    bit_of_rows: ("read", "check", "verify", "resume", "seal"),
    chunk_of_zeros: ("check", "verify", "resume", "seal"),
    other_zeros: ("check", "verify", "resume", "seal"),
    truncation: ("read", "check", "verify", "resume", "seal"),
    missing_rows: ("read", "check", "verify", "resume", "seal"),
    an_attribute: ("check", "verify", "resume", "seal"),
}
"""As the table at the top of datasets/storage/hdf5.py has it."""


def finds(path, way):
    """Whether reading, checking or verifying a file finds that something is wrong with its content."""
    if way == "check":
        return any("are done" not in problem for problem in check_file(path))
    try:
        with ContourFile(path, verify=way == "verify") as file:
            file.contours(), file.metrics(), file.timing()
    except ContourFileError:
        return True
    return False


def findings(path):
    return tuple(way for way in ("read", "check", "verify") if finds(path, way))


@pytest.mark.parametrize("damage", FOUND, ids=lambda damage: damage.__name__)
def test_damage_of_a_sealed_file_is_found_when_it_is_said_to_be(sealed, damage):
    assert findings(sealed) == ()
    damage(sealed)
    assert findings(sealed) == FOUND[damage][:-2]


@pytest.fixture(scope="module")
def committed(tmp_path_factory):
    """A folder with a rendering of two blocks, which nobody has sealed."""
    folder = tmp_path_factory.mktemp("committed")
    with small_chunks(), ContourWriter(folder / "out.h5", make_header(POSES)) as writer:
        write_ranges(writer, CONTOURS, [(0, 6), (6, 12)])
    return folder


@pytest.mark.exhaustive
@pytest.mark.parametrize("damage", FOUND, ids=lambda damage: damage.__name__)
def test_damage_of_a_block_is_found_when_it_is_said_to_be_and_its_poses_are_rendered_again(tmp_path, committed, damage):
    path = shutil.copytree(committed, tmp_path / "copy") / "out.h5"
    block = path.with_name("out.h5.partial") / "poses-000000000006-000000000012.h5"
    with ContourWriter(path, make_header(POSES), mode="resume") as writer:
        assert writer.missing() == []
        damage(block)
        assert findings(path) == FOUND[damage][:-2]
        with pytest.raises(ContourFileError, match=block.name):
            writer.seal()
    assert not path.exists()
    missing, repairs = finish(path, CONTOURS)
    assert missing == [(6, 12)]
    assert len(repairs) == 1
    assert block.name in repairs[0]
    assert repairs[0].endswith("dropped, its poses are rendered again")


@pytest.mark.parametrize("damage", [chunk_of_zeros, an_attribute], ids=lambda damage: damage.__name__)
def test_a_header_that_is_not_what_was_written_is_not_gone_on_with(tmp_path, committed, damage):
    path = shutil.copytree(committed, tmp_path / "copy") / "out.h5"
    header = path.with_name("out.h5.partial") / "header.h5"
    if damage is chunk_of_zeros:
        zero_chunk(header, "/object/vertices")
    else:
        with h5py.File(header, "r+") as file:
            put_text(file, "device", "gpu")
    assert findings(path) == ("check", "verify")
    with pytest.raises(ContourFileError, match=r"header\.h5.* not what was written"):
        ContourWriter(path, make_header(POSES), mode="resume")
    assert len(list(header.parent.glob("poses-*"))) == 2


def test_zeros_in_any_dataset_are_found(sealed):
    for spec in FIELDS:
        zero_chunk(sealed, spec.path)
    problems = check_file(sealed)
    for spec in FIELDS:
        assert any(f"{spec.path} is damaged: its rows are not what was" in problem for problem in problems), spec.path


def test_digests_that_are_none_are_refused(sealed):
    told = stored_digests(sealed)
    for broken, message in (
        ("[]", "digests of / is damaged"),
        ("{", "digests of / is damaged"),
        ('{"datasets": {}, "attributes": {"/": "x"}}', "digests of / is damaged"),
        ("[" * 50_000, "digests of / is damaged"),
        ('{"block_rows": 1, "datasets": {}, "attributes": {}}', r"has no digests of whole datasets, as 1\.5 has"),
        (json.dumps(told | {"datasets": {"/contours": ""}}), "/contours is missing or not a dataset"),
        (json.dumps(told | {"datasets": {"/text": "0" * 16}}), "/text is text, expected numbers"),
        (json.dumps(told | {"datasets": {}}), "/contours/points has no digest"),
    ):
        with h5py.File(sealed, "a") as file:
            put_text(file, "digests", broken)
            file.require_dataset("/text", (1,), h5py.string_dtype())[0] = "x"
        with pytest.raises(ContourFileError, match=message):
            ContourFile(sealed, verify=True)
        assert any("digest" in problem or "/contours is" in problem for problem in check_file(sealed)), broken


def write_old(path, minor):
    """A file as palpate of that version wrote it, by h5py alone; its digests of blocks, from 1.2 on, are wrong."""
    contours, given = make_contours(3, dwell=minor > 0), everything(3) if minor > 0 else {}
    if minor < 4:
        given = {name: own for name, own in given.items() if not name.startswith("live")}
    header = make_header(3, **given, provenance={"model": "over-array"} if minor > 2 else None)
    own = header.arrays()
    live = header.live_arrays
    groups = {
        "contours": contours,
        "metrics": make_metrics(contours),
        "live": live,
        "timing": {"first": np.zeros(1, "<i8"), "stop": np.full(1, 3), "seconds": np.ones((1, 1))},
    }
    own = {name: rows for name, rows in own.items() if name not in live}
    with h5py.File(path, "w") as file:
        for spec in FIELDS:
            if (rows := groups.get(spec.group, own).get(spec.name)) is not None:
                made = file.create_dataset(spec.path, data=rows, fletcher32=True)
                put_text(made, "units", spec.unit)
                put_text(made, "frame", spec.frame)
        file.attrs["version"] = np.array([1, minor], np.int32)
        file["motion"].attrs["offset"] = 0.0
        file.attrs["seed"] = 7
        texts = {
            "/": {"format": "palpate contours", "device": "cpu", "created": header.created},
            "/object": {"name": header.object_name, "hash": header.object_hash, "attributes": {}},
            "/motion": {"provenance": header.provenance},
            "/hand": {"description": header.hand},
            "/timing": {"stages": {"stages": ["raw"]}},
            "/live": {"run": header.live},
        }
        texts["/"] |= {"strategy": header.strategy, "versions": header.versions}
        texts["/"] |= {"recipe": header.recipe | {"format": f"1.{minor}"}}
        texts["/object"] |= {"placement": header.placement, "representation": header.representation or None}
        if minor > 1:
            file["/digests/block"] = np.zeros(9, "<u8")
            texts["/"]["digests"] = {"block_rows": 8192, "datasets": {"/contours/points": [0, "0" * 32]}} | {
                "attributes": {"/": {"device": "0" * 16}}
            }
        for group, values in texts.items():
            for key, value in values.items():
                if value is not None:
                    put_text(file.require_group(group), key, value if isinstance(value, str) else json.dumps(value))
    return contours, header


@pytest.mark.parametrize("minor", range(5))
def test_files_of_older_versions_are_read_and_whole_but_nothing_proves_them(tmp_path, minor):
    """By docs/formats/file-format.md, which says what each version brought."""
    path = tmp_path / "old.h5"
    contours, header = write_old(path, minor)
    assert check_file(path) == []
    assert len(unproven_content(path)) == 1
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)
        assert_same(file.metrics(), make_metrics(contours))
        assert_same(file.header().arrays(), header.arrays())
        assert (file.live_run is not None, "motion" in file.attributes) == (minor > 3, minor > 2)
    with pytest.raises(ContourFileError, match=r"no digests that prove its content: format 1\.5 brought them"):
        ContourFile(path, verify=True)
    with pytest.raises(ContourFileError, match=f"another rendering: format was 1.{minor} and is now 1.5"):
        ContourWriter(path, header, mode="resume")


def test_a_file_that_a_newer_minor_version_wrote_is_read(sealed):
    with h5py.File(sealed, "r+") as file:
        file.attrs["version"] = np.array([1, 9], np.int32)
        file["/contours/colour"] = np.zeros(3)
        file["/focus/points"] = h5py.SoftLink("/nowhere")
    redigest(sealed)
    assert (check_file(sealed), unproven_content(sealed)) == ([], [])
    with ContourFile(sealed, verify=True) as file:
        assert_same(file.contours(), CONTOURS)
