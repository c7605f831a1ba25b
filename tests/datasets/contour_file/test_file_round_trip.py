"""The contour file gives back what was written, whatever the blocks, and is laid out as documented."""

import itertools
import tempfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from contour_cases import (
    assert_same,
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

from palpate.datasets.contour_file.check import check_file, contour_lengths
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
/digests
/digests/block uint64 [19] units=1 frame=none fletcher32
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
def folder():
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@st.composite
def renderings(draw):
    """Contours, and the pose ranges of their blocks in some order."""
    count = draw(st.integers(1, 30))
    intensity = draw(st.booleans())
    contours = make_contours(count, seed=draw(st.integers(0, 1000)), intensity=intensity, dwell=draw(st.booleans()))
    cuts = [0, *sorted(draw(st.sets(st.integers(1, count - 1), max_size=6)) if count > 1 else []), count]
    return contours, draw(st.permutations(list(itertools.pairwise(cuts))))


@pytest.mark.exhaustive
@given(renderings(), st.data())
@settings(max_examples=40, deadline=None)
def test_what_is_written_in_any_blocks_is_read_back_in_any_ranges(rendering, data):
    contours, ranges = rendering
    count = len(contours["pose_start"]) - 1
    first = data.draw(st.integers(0, count - 1))
    stop = data.draw(st.integers(first + 1, count))
    part = cut_contours(contours, first, stop)
    with tempfile.TemporaryDirectory() as name, small_chunks():
        path = Path(name) / "out.h5"
        with ContourWriter(path, make_header(count)) as writer:
            write_ranges(writer, contours, ranges)
            assert writer.missing() == []
            with ContourFile(path) as unsealed:
                assert_same(unsealed.contours(first, stop), part)
                assert_same(unsealed.metrics(first, stop), make_metrics(part))
            writer.seal()
        assert check_file(path) == []
        with ContourFile(path) as file:
            assert (file.sealed, file.done) == (True, [(0, count)])
            assert (file.point_count, file.polyline_count) == (len(contours["kind"]), len(contours["polyline_patch"]))
            assert_same(file.contours(), contours)
            assert_same(file.contours(first, stop), part)
            assert_same(file.metrics(first, stop), make_metrics(part))
            assert len(file.contours(first, first)["points"]) == 0


def test_the_header_is_read_back_as_it_was_given(folder):
    changes = {"time": None, "time_offset": 1.5, "object_attributes": {"mended": [1]}} | everything(3)
    header = write_file(folder / "a.h5", make_contours(3), **changes)
    plain = set(make_header(3, time=None).recipe)
    assert set(header.recipe) - plain == {"representation", "object motion", "object attributes"} & set(header.recipe)
    with ContourFile(folder / "a.h5") as file:
        got = file.header()
        assert_same(got.arrays(), header.arrays())
        assert got.recipe == header.recipe == file.recipe
        assert (got.time_offset, got.device, got.seed, got.created) == (1.5, "cpu", 7, header.created)
        assert (got.object_attributes, got.placement) == ({"mended": [1]}, {"scale": 1.0})
        assert file.object()["hash"] == header.object_hash
        assert list(file.motion()) == ["pose"]
        assert file.attributes["version"] == [1, 4]
        assert (file.strategy, file.hand) == (header.strategy, header.hand)


def test_poses_without_optional_fields_have_what_their_absence_means_where_others_have_them(folder):
    plain, some = make_contours(4, seed=1), make_contours(3, seed=2, intensity=True, dwell=True)
    with ContourWriter(folder / "a.h5", make_header(7)) as writer:
        writer.write(0, 4, plain, make_metrics(plain))
        writer.write(4, 7, some, make_metrics(some))
        writer.commit()
        with ContourFile(folder / "a.h5") as unsealed:
            before = unsealed.contours()
        writer.seal()
    with ContourFile(folder / "a.h5") as file:
        want = np.concatenate([np.ones(len(plain["points"]), np.float32), some["intensity"]])
        np.testing.assert_array_equal(file.contours()["intensity"], want)
        want = np.concatenate([np.zeros(len(plain["points"]), np.float32), some["dwell"]])
        np.testing.assert_array_equal(file.contours()["dwell"], want)
        np.testing.assert_array_equal(file.metrics()["removed_small"], [0, 0, 0, 0, *np.diff(some["pose_start"])])
        assert_same(before, file.contours())


def test_timing_keeps_a_column_for_each_stage_of_any_chunk(folder):
    contours = make_contours(6)
    parts = [cut_contours(contours, 0, 2), cut_contours(contours, 2, 6)]
    with ContourWriter(folder / "a.h5", make_header(6)) as writer:
        writer.write(2, 6, parts[1], make_metrics(parts[1]), {"close": 2.0, "raw": 1.0})
        writer.write(0, 2, parts[0], make_metrics(parts[0]), {"raw": 0.5})
        writer.seal()
    with ContourFile(folder / "a.h5") as file:
        timing = file.timing()
    assert timing.stages == ["raw", "close"]
    np.testing.assert_array_equal(timing.first, [0, 2])
    np.testing.assert_array_equal(timing.stop, [2, 6])
    np.testing.assert_array_equal(timing.seconds, [[0.5, np.nan], [1.0, 2.0]])


def test_blocks_cover_every_pose_done_once_within_the_limit(folder):
    contours = make_contours(50)
    with ContourWriter(folder / "a.h5", make_header(60)) as writer:
        write_ranges(writer, contours, [(0, 13), (13, 30)])
        with ContourFile(folder / "a.h5") as file:
            blocks = list(file.blocks(point_limit=20))
    assert [first for first, _ in blocks] == [0, *(stop for _, stop in blocks[:-1])]
    assert blocks[-1][1] == 30
    sizes = [len(cut_contours(contours, first, stop)["points"]) for first, stop in blocks]
    assert all(size <= 20 or stop - first == 1 for size, (first, stop) in zip(sizes, blocks, strict=True))
    assert max(sizes) > 10


def test_poses_not_done_are_refused_and_the_rest_is_read(folder):
    contours = make_contours(10)
    with ContourWriter(folder / "a.h5", make_header(10)) as writer:
        write_ranges(writer, contours, [(2, 4), (4, 5), (8, 10)])
        assert writer.missing() == [(0, 2), (5, 8)]
        with ContourFile(folder / "a.h5") as file:
            assert (file.sealed, file.done, file.pose_count) == (False, [(2, 5), (8, 10)], 10)
            assert_same(file.contours(3, 5), cut_contours(contours, 3, 5))
            for first, stop, missing in ((0, 10, 0), (3, 9, 5), (7, 8, 7)):
                with pytest.raises(ContourFileError, match=f"pose {missing} .* not done"):
                    file.contours(first, stop)
            with pytest.raises(ContourFileError, match="out of range"):
                file.metrics(9, 11)
        with pytest.raises(ContourFileError, match="5 poses are missing, from 0 on"):
            writer.seal()


@pytest.mark.exhaustive
def test_compression_changes_the_size_and_nothing_else(folder):
    contours = make_contours(1000)
    contours["points"] = np.round(contours["points"], 1)
    for name, gzip in (("a.h5", 0), ("b.h5", 1)):
        with ContourWriter(folder / name, make_header(1000)) as writer:
            write_ranges(writer, contours, [(0, 1000)])
            writer.seal(gzip=gzip)
    with ContourFile(folder / "a.h5") as a, ContourFile(folder / "b.h5") as b:
        assert_same(a.contours(), b.contours())
    assert (folder / "b.h5").stat().st_size < 0.85 * (folder / "a.h5").stat().st_size
    assert check_file(folder / "b.h5") == []


def test_lengths_are_those_of_a_plain_loop():
    contours = make_contours(40, seed=5)
    want = make_metrics(contours)
    for name, length in contour_lengths(contours).items():
        np.testing.assert_allclose(length, want[name], rtol=1e-6, atol=0, err_msg=name)


def test_the_file_is_laid_out_as_it_always_was(folder):
    write_file(folder / "a.h5", make_contours(5, seed=4, intensity=True), chunk=3)
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

    with h5py.File(folder / "a.h5") as file:
        describe("", file)
        file.visititems(describe)
        assert file.attrs["format"] == b"palpate contours"
        assert file.attrs["version"].tolist() == [1, 4]
    assert "\n".join(lines) + "\n" == STRUCTURE


def test_the_document_names_every_dataset_and_attribute():
    text = DOCUMENT.read_text()
    names = [line.split()[0] for line in STRUCTURE.splitlines()]
    attributes = [word for line in STRUCTURE.splitlines() if "[" not in line for word in line.split()[1:]]
    missing = [name for name in [*names, *attributes] if f"`{name}`" not in text]
    assert not missing
