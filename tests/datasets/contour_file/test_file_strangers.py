"""What others put in a writer's way: logs that lie with right checksums, pipes, links, and its own name taken."""

import json
import os
import struct
import zlib
from itertools import islice

import h5py
import numpy as np
import pytest
from contour_cases import assert_same, make_contours, make_header, make_metrics, redigest, write_file, write_ranges

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError


def record(head, content=b""):
    """A record as docs/formats/file-format.md describes it, made here without palpate's own code."""
    text = head if isinstance(head, bytes) else json.dumps(head).encode()
    payload = struct.pack("<I", len(text)) + text + content
    prefix = struct.pack("<II", len(payload), zlib.crc32(payload))
    return prefix + struct.pack("<I", zlib.crc32(prefix)) + payload


def records(content):
    while content:
        size = struct.unpack_from("<I", content)[0]
        length = struct.unpack_from("<I", content, 12)[0]
        yield json.loads(content[16 : 16 + length]), content[16 + length : 12 + size]
        content = content[12 + size :]


@pytest.fixture
def begun(tmp_path):
    with ContourWriter(tmp_path / "out.h5", make_header(10)) as writer:
        write_ranges(writer, make_contours(10), [(0, 4), (4, 6)])
    return tmp_path / "out.h5"


def log_of(path):
    return path.with_name("out.h5.partial") / "poses-000000000000.log"


_NESTED = b"[" * 100_000 + b"]" * 100_000
_FIRST = [
    _NESTED,
    b"null",
    [1, 2],
    b'{"first": ' + b"9" * 5000 + b"}",
    {"first": float("inf")},
    {"first": 3},
    {"begin": float("inf")},
    {"begin": 10**30},
    {"begin": -5},
    {"optional": 5},
    {"chunk_rows": 2},
    {"digests": "md5"},
]
_SECOND = [
    b'{"stop": 4, "counts": ' + _NESTED + b"}",
    {"counts": [float("inf")] * 11},
    {"counts": [10**30] * 11},
    {"counts": [8192 * 10**9] * 11},
    {"counts": [-1] * 11},
    {"counts": []},
    {"chunks": -1},
    {"chunks": 10**18},
    {"stop": 10**40},
    {"stop": 0},
    {"stop": True},
    {"stop": float("nan")},
    {"timing": {"a": "b"}},
    {"timing": {"a": [1]}},
    {"timing": 5},
]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("number", "change"), [*((0, own) for own in _FIRST), *((1, own) for own in _SECOND)])
def test_a_log_that_says_the_impossible_ends_where_it_says_it(begun, number, change):
    log = log_of(begun)
    told = list(records(log.read_bytes()))
    assert b"".join(record(*own) for own in told) == log.read_bytes()
    head, content = told[number]
    told[number] = (head | change if isinstance(change, dict) else change), content
    log.write_bytes(b"".join(record(*own) for own in told))
    problems = check_file(begun)
    assert any("poses-000000000000.log is truncated or damaged" in problem for problem in problems)
    with ContourFile(begun) as file:
        assert file.pose_count == 10
        with pytest.raises(ContourFileError, match="not done"):
            file.contours(0, 4)
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == [(0, 10)]
        assert "is truncated or damaged" in writer.repairs[0]


def test_a_time_that_is_no_number_loses_no_poses(tmp_path):
    path, contours = tmp_path / "out.h5", make_contours(4)
    with ContourWriter(path, make_header(4)) as writer:
        writer.write(0, 4, contours, make_metrics(contours), {"trace": float("nan")})
    with ContourWriter(path, make_header(4), mode="resume") as writer:
        assert (writer.missing(), writer.repairs) == ([], ())
        writer.seal()
    with ContourFile(path, verify=True) as file:
        assert np.isnan(file.timing().seconds).all()


def test_a_log_of_six_gigabytes_of_nothing_is_refused_without_reading_it(begun):
    os.truncate(log_of(begun), 6 << 30)
    assert [problem for problem in check_file(begun) if "truncated or damaged after pose 6" in problem]


@pytest.mark.parametrize("suffix", [".log", ".rows"])
def test_a_pipe_in_place_of_a_part_is_no_part(begun, suffix):
    path = log_of(begun).with_suffix(suffix)
    path.unlink()
    os.mkfifo(path)
    assert [problem for problem in check_file(begun) if str(path.with_suffix("")) in problem]
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == [(0, 10)]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("mode", ["create", "resume"])
def test_a_file_that_appears_meanwhile_is_not_replaced(tmp_path, mode):
    path, contours = tmp_path / "out.h5", make_contours(10)
    with ContourWriter(path, make_header(10), mode=mode) as writer:
        write_ranges(writer, contours, [(0, 10)])
        path.write_text("somebody's")
        with pytest.raises(
            ContourFileError, match=r"out.h5 is not of the unfinished rendering .*move it away.*mode=.resume"
        ):
            writer.seal()
        assert path.read_text() == "somebody's"
    with pytest.raises(ContourFileError, match="is not of the unfinished rendering"):
        ContourWriter(path, make_header(10), mode="resume")
    path.rename(tmp_path / "theirs")
    with ContourWriter(path, make_header(10), mode="resume") as writer:
        assert writer.missing() == []
        writer.seal()
    with ContourFile(path, verify=True) as file:
        assert_same(file.contours(), contours)


@pytest.mark.exhaustive
def test_permission_to_overwrite_lasts_until_the_file_is_sealed(tmp_path):
    path, contours = tmp_path / "out.h5", make_contours(10)
    write_file(path, make_contours(4))
    with ContourWriter(path, make_header(10), mode="overwrite") as writer:
        write_ranges(writer, contours, [(0, 4)])
    with ContourWriter(path, make_header(10), mode="resume") as writer:
        write_ranges(writer, contours, [(4, 10)])
        writer.seal()
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)
    assert sorted(own.name for own in tmp_path.iterdir()) == ["out.h5"]


@pytest.mark.parametrize("mode", ["create", "resume", "overwrite"])
def test_a_work_folder_that_is_a_link_is_refused_and_what_lies_there_stays(tmp_path, mode):
    theirs = tmp_path / "documents"
    theirs.mkdir()
    for name in ("a.tmp", "poses-000000000000.log", "thesis.txt"):
        (theirs / name).write_text(name)
    (tmp_path / "out.h5.partial").symlink_to(theirs)
    with pytest.raises(ContourFileError, match=r"out.h5.partial is no folder of its own, but a file or a link"):
        ContourWriter(tmp_path / "out.h5", make_header(10), mode=mode)
    assert {own.name: own.read_text() for own in theirs.iterdir()} == {own.name: own.name for own in theirs.iterdir()}
    assert len(list(theirs.iterdir())) == 3


def test_nothing_is_removed_from_a_folder_that_resuming_refuses(begun):
    mine = log_of(begun).with_name("mine.tmp")
    mine.write_text("mine")
    with pytest.raises(ContourFileError, match="another rendering"):
        ContourWriter(begun, make_header(10, strategy={}), mode="resume")
    assert mine.read_text() == "mine"


def changed_digests(path, change):
    with h5py.File(path, "r+") as file:
        told = json.loads(file.attrs["digests"])
        change(told)
        text = json.dumps(told).encode()
        file.attrs["digests"] = np.array(text, h5py.string_dtype("utf-8", len(text)))


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda told: told["datasets"].pop("/contours/points"), "/contours/points.* no digest"),
        (lambda told: told["attributes"].clear(), "attribute .* of / has no digest"),
        (lambda told: told["attributes"]["/"].pop("seed"), "attribute seed of / has no digest"),
        (lambda told: told["datasets"].update({"/contours": [0, ""]}), "/contours"),
    ],
)
def test_what_digests_leave_out_is_no_whole_file(tmp_path, change, message):
    path = tmp_path / "out.h5"
    write_file(path, make_contours(10), seed=3)
    redigest(path)
    assert check_file(path) == []
    changed_digests(path, change)
    with pytest.raises(ContourFileError, match=message):
        ContourFile(path, verify=True)
    assert list(islice((problem for problem in check_file(path) if "digest" in problem), 1))
