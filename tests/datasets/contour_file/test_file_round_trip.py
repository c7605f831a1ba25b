"""The contour file gives back what was written, whatever the blocks, and is laid out as documented."""

import itertools
import tempfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from contour_cases import (
    assert_same,
    assert_whole,
    content_digests,
    cut_contours,
    everything,
    make_contours,
    make_header,
    make_metrics,
    small_chunks,
    write_file,
    write_ranges,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

DOCUMENT = Path(__file__).parents[3] / "docs/formats/file-format.md"

STRUCTURE = """\
/ created device digests format recipe seed strategy version versions
/contours
/contours/intensity float32 [66] units=1 frame=none fletcher32
/contours/kind uint8 [66] units=1 frame=none fletcher32
/contours/points float32 [66, 3] units=m frame=array fletcher32
/contours/polyline_closed uint8 [9] units=1 frame=none fletcher32
/contours/polyline_patch int32 [9] units=1 frame=none fletcher32
/contours/polyline_start int64 [10] units=1 frame=none fletcher32
/contours/pose_start int64 [6] units=1 frame=none fletcher32
/hand description
/metrics
/metrics/length float32 [5] units=m frame=none fletcher32
/metrics/length_hand float32 [5] units=m frame=none fletcher32
/metrics/length_made float32 [5] units=m frame=none fletcher32
/metrics/length_object float32 [5] units=m frame=none fletcher32
/metrics/polylines int32 [5] units=1 frame=none fletcher32
/motion offset
/motion/pose float32 [5, 7] units=m (x y z), 1 (qx qy qz qw) frame=array fletcher32
/motion/time float64 [5] units=s frame=none fletcher32
/object attributes hash name placement
/object/faces int32 [4, 3] units=1 frame=none fletcher32
/object/vertices float32 [4, 3] units=m frame=array fletcher32
/timing stages
/timing/first int64 [2] units=1 frame=none fletcher32
/timing/seconds float64 [2, 1] units=s frame=none fletcher32
/timing/stop int64 [2] units=1 frame=none fletcher32
"""


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out.h5"


def test_poses_are_read_one_by_one_in_any_order(path):
    contours = make_contours(40)
    with small_chunks(7):
        write_file(path, contours)
    with ContourFile(path) as file:
        for pose in np.random.default_rng(2).permutation(40):
            assert_same(file.contours(pose, pose + 1), cut_contours(contours, pose, pose + 1))
            assert file.metrics(pose, pose + 1)["polylines"] == np.diff(contours["pose_start"])[pose]


@st.composite
def renderings(draw):
    """Contours, and the pose ranges of their blocks in some order, each with whether it is held until the end."""
    count = draw(st.integers(1, 30))
    intensity = draw(st.booleans())
    contours = make_contours(count, seed=draw(st.integers(0, 1000)), intensity=intensity, dwell=draw(st.booleans()))
    cuts = [0, *sorted(draw(st.sets(st.integers(1, count - 1), max_size=6)) if count > 1 else []), count]
    ranges = draw(st.permutations(list(itertools.pairwise(cuts))))
    return contours, [(own, draw(st.booleans())) for own in ranges]


@pytest.mark.exhaustive
@given(renderings(), st.integers(0, 1), st.data())
@settings(max_examples=40)
def test_what_is_written_in_any_blocks_is_read_back_in_any_ranges_and_sealed_to_the_content_of_one_write(
    rendering, gzip, data
):
    contours, ranges = rendering
    count = len(contours["pose_start"]) - 1
    first = data.draw(st.integers(0, count - 1))
    stop = data.draw(st.integers(first + 1, count))
    part = cut_contours(contours, first, stop)
    with tempfile.TemporaryDirectory() as name, small_chunks():
        path, at_once = Path(name) / "out.h5", Path(name) / "at_once.h5"
        write_file(at_once, contours, chunk=count)
        with ContourWriter(path, make_header(count)) as writer:
            for own, held in ranges:
                write_ranges(writer, contours, [own], held=held)
            assert writer.missing() == []
            writer.seal(gzip=gzip)
        assert_whole(path, contours)
        assert content_digests(path) == content_digests(at_once)
        with ContourFile(path) as file, h5py.File(path) as plain:
            assert plain["/metrics/length"].compression == ("gzip" if gzip else None)
            assert file.done == [(0, count)]
            assert (file.point_count, file.polyline_count) == (len(contours["kind"]), len(contours["polyline_patch"]))
            assert_same(file.contours(first, stop), part)
            assert_same(file.metrics(first, stop), make_metrics(part))
            assert len(file.contours(first, first)["points"]) == 0


def test_the_header_is_read_back_as_it_was_given(path):
    changes = {"time": None, "time_offset": 1.5, "object_attributes": {"mended": [1]}} | everything(3)
    header = write_file(path, make_contours(3), **changes)
    assert set(header.recipe) - set(make_header(3, time=None).recipe) == {"representation", "object motion"}
    with ContourFile(path) as file:
        got = file.header()
        assert_same(got.arrays(), header.arrays())
        assert got.recipe == header.recipe == file.recipe
        assert (got.time_offset, got.device, got.seed, got.created) == (1.5, "cpu", 7, header.created)
        assert (got.object_attributes, got.placement) == ({"mended": [1]}, {"scale": 1.0})
        assert file.object()["hash"] == header.object_hash
        assert list(file.motion()) == ["pose"]
        assert file.attributes["version"] == [1, 5]
        assert (file.strategy, file.hand) == (header.strategy, header.hand)


def test_what_only_some_ranges_have_is_absent_in_the_others(path):
    """1 for an intensity, 0 for a dwell and what was removed, NaN for a time: docs/formats/file-format.md."""
    full = make_contours(8, seed=1, intensity=True, dwell=True)
    plain = {name: rows for name, rows in full.items() if name not in ("intensity", "dwell")}
    seconds = {0: {"raw": 1.0}, 2: {"close": 5.0}, 4: {"raw": 10.0, "sort": 2.0}, 6: {"close": 15.0}}
    with ContourWriter(path, make_header(8)) as writer:
        for first in (6, 0, 4, 2):
            part = cut_contours(full if first in (2, 4) else plain, first, first + 2)
            writer.write(first, first + 2, part, make_metrics(part), seconds[first])
            if first in (0, 4):  # 6 to 8 with 0 to 2; 2 to 4 is held until the file is sealed
                writer.commit()
        with ContourFile(path) as unsealed:
            before = unsealed.contours(4, 8)
        writer.seal()
    points = full["polyline_start"][full["pose_start"]][[2, 6]]
    want = {"intensity": np.ones_like(full["intensity"]), "dwell": np.zeros_like(full["dwell"])}
    for name, rows in want.items():
        rows[slice(*points)] = full[name][slice(*points)]
    assert_whole(path, plain | want)
    assert_same(before, cut_contours(plain | want, 4, 8))
    with ContourFile(path) as file:
        removed, timing = file.metrics()["removed_small"], file.timing()
    np.testing.assert_array_equal(removed, np.where(np.arange(8) // 2 % 3 == 0, 0, np.diff(full["pose_start"])))
    assert (timing.first.tolist(), timing.stop.tolist()) == ([0, 2, 4, 6], [2, 4, 6, 8])
    assert timing.stages == ["raw", "close", "sort"]
    none = np.nan
    want = [[1, none, none], [none, 5, none], [10, none, 2], [none, 15, none]]
    np.testing.assert_array_equal(timing.seconds, want)


def test_blocks_cover_every_pose_done_once_within_the_limit(path):
    contours = make_contours(50)
    with ContourWriter(path, make_header(60)) as writer:
        write_ranges(writer, contours, [(0, 13), (13, 30)])
        with ContourFile(path) as file:
            blocks = list(file.blocks(point_limit=20))
    assert [first for first, _ in blocks] == [0, *(stop for _, stop in blocks[:-1])]
    assert blocks[-1][1] == 30
    sizes = [len(cut_contours(contours, first, stop)["points"]) for first, stop in blocks]
    assert all(size <= 20 or stop - first == 1 for size, (first, stop) in zip(sizes, blocks, strict=True))
    assert max(sizes) > 10


def test_poses_not_done_are_refused_and_the_rest_is_read(path):
    contours = make_contours(10)
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, contours, [(2, 4), (4, 5), (8, 10)])
        assert writer.missing() == [(0, 2), (5, 8)]
        with ContourFile(path) as file:
            assert (file.sealed, file.done, file.pose_count) == (False, [(2, 5), (8, 10)], 10)
            assert_same(file.contours(3, 5), cut_contours(contours, 3, 5))
            for first, stop, missing in ((0, 10, 0), (3, 9, 5), (7, 8, 7)):
                with pytest.raises(ContourFileError, match=f"pose {missing} .* not done"):
                    file.contours(first, stop)
            with pytest.raises(ContourFileError, match="out of range"):
                file.metrics(9, 11)
        with pytest.raises(ContourFileError, match="5 poses are missing, from 0 on"):
            writer.seal()


def test_long_texts_are_kept(path):
    """HDF5 keeps an attribute of 64 KiB and more elsewhere than a shorter one (File Format Specification, IV.A.2.m)."""
    contours, stages = make_contours(3), [f"stage {k} {'x' * 200}" for k in range(200)]
    strategy, hand = {"raw": "mesh", "note": "x" * 60_000}, {"kind": "palm", "note": "y" * 200_000}
    with ContourWriter(path, make_header(3, strategy=strategy, hand=hand)) as writer:
        writer.write(0, 3, contours, make_metrics(contours), dict.fromkeys(stages, 0.5))
        writer.commit()
        writer.seal()
    assert_whole(path, contours)
    with ContourFile(path) as file:
        assert (file.strategy, file.hand, file.timing().stages) == (strategy, hand, stages)


def test_the_file_is_laid_out_as_it_always_was(path):
    write_file(path, make_contours(5, seed=4, intensity=True), chunk=3)
    lines: list[str] = []

    def describe(name, item):
        attributes = sorted(item.attrs)
        if isinstance(item, h5py.Group):
            lines.append(" ".join([f"/{name}", *attributes]))
            return
        values = " ".join(f"{key}={item.attrs[key].decode()}" for key in ("units", "frame"))
        assert attributes == ["frame", "units"]
        checked = " fletcher32" if item.fletcher32 else ""
        lines.append(f"/{name} {item.dtype} {list(item.shape)} {values}{checked}")

    with h5py.File(path) as file:
        describe("", file)
        file.visititems(describe)
        assert file.attrs["format"] == b"palpate contours"
        assert file.attrs["version"].tolist() == [1, 5]
    assert "\n".join(lines) + "\n" == STRUCTURE


def test_the_document_names_every_dataset_and_attribute():
    text = DOCUMENT.read_text()
    names = [line.split()[0] for line in STRUCTURE.splitlines()]
    attributes = [word for line in STRUCTURE.splitlines() if "[" not in line for word in line.split()[1:]]
    missing = [name for name in [*names, *attributes] if f"`{name}`" not in text]
    assert not missing
