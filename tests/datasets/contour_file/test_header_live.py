"""The live run of a file: its description is read back, and arrays that contradict it are found and named."""

import numpy as np
import pytest
from contour_cases import live_run, make_contours, write_file

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.header_live import RecordedRun, require_live
from palpate.datasets.contour_file.live_summary import summarise_run
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.unknown_content import unknown_content
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError
from palpate.datasets.storage.schema import LIVE

ROWS = {"stamp": 3, "emitted": 3, "position": 18, "intensity": 18, "mark": 9, "events": 40}


def test_a_live_run_is_read_back_in_parts_and_summed_up(tmp_path):
    given = live_run(3)
    write_file(tmp_path / "a.h5", make_contours(3), **given)
    assert check_file(tmp_path / "a.h5") == unknown_content(tmp_path / "a.h5") == []
    with ContourFile(tmp_path / "a.h5", verify=True) as file:
        assert file.live_run == RecordedRun.from_json(given["live"])
        assert file.live_run.duration == 0.09
        for name, rows in given["live_arrays"].items():
            np.testing.assert_array_equal(file.live_rows(name), rows, strict=True)
            np.testing.assert_array_equal(file.live_rows(name, 1, 3), rows[1:3], strict=True)
        summary = summarise_run(file)
    assert summary["latency_p50"] == summary["latency_max"] == pytest.approx(1.0 - 2 / 90 + 0.006)
    assert (summary["poses"], summary["poses_emitted"], summary["seconds_dropped"]) == (3, 1, 1)
    assert [summary[name] for name in ("emitted", "dropped", "held", "faded")] == [3, 2, 2, 2]


def test_a_live_run_of_which_no_emission_is_known_has_no_latency(tmp_path):
    given = live_run(3)
    given["live_arrays"]["emitted"] = np.full(3, np.nan)
    del given["live_arrays"]["gain"]
    write_file(tmp_path / "a.h5", make_contours(3), **given)
    assert check_file(tmp_path / "a.h5") == []
    with ContourFile(tmp_path / "a.h5") as file:
        assert summarise_run(file)["latency_p99"] is None
        assert not file.has_live("gain")


def test_a_file_of_no_live_run_has_none(tmp_path):
    write_file(tmp_path / "a.h5", make_contours(3))
    with ContourFile(tmp_path / "a.h5") as file:
        assert file.live_run is summarise_run(file) is None
        assert not any(spec.path in file.parts()[0] for spec in LIVE)


BAD_RUNS = {
    "hold": (float("nan"), "hold must be a finite number above 0, not nan"),
    "update_rate": (0, "update_rate must be a finite number above 0, not 0"),
    "samples": (9.0, "samples must be a whole number of 1 or more, not 9.0"),
    "foci": (True, "foci must be a whole number of 1 or more, not True"),
    "realtime": (1, "realtime must be of type bool, not 1"),
    "source": (None, "source must be of type str, not None"),
    "sampling": ("stm", "sampling must be a JSON object, not 'stm'"),
}


@pytest.mark.parametrize("name", BAD_RUNS)
def test_a_description_with_a_wrong_value_is_refused_by_name(name):
    value, sentence = BAD_RUNS[name]
    run = live_run(3)["live"]
    with pytest.raises(ContourFileError, match=sentence):
        require_live(run | {name: value}, ROWS, 3)
    with pytest.raises(ContourFileError, match=f"its attribute run has no '{name}'"):
        require_live({key: own for key, own in run.items() if key != name}, ROWS, 3)


@pytest.mark.parametrize("name", ROWS)
def test_arrays_that_are_missing_or_of_another_number_of_rows_are_found(name):
    run = live_run(3)["live"]
    require_live(run, ROWS, 3)
    with pytest.raises(ContourFileError, match=f"/live/{name} is missing"):
        require_live(run, {key: own for key, own in ROWS.items() if key != name}, 3)
    if name != "events":
        with pytest.raises(ContourFileError, match=f"/live/{name} has {ROWS[name] + 1} rows, expected {ROWS[name]}"):
            require_live(run, ROWS | {name: ROWS[name] + 1}, 3)
    with pytest.raises(ContourFileError, match=f"/live/{name} is there, but /live has no attribute run"):
        require_live(None, {name: 3}, 3)


@pytest.mark.parametrize(
    ("name", "row", "value", "sentence"),
    [
        ("mark", 4, 4, "/live/mark: outside 0 to 3 (1, first 4)"),
        ("gain", 2, -0.5, "/live/gain: below 0 (1, first 2)"),
        ("position", (7, 1), np.nan, "/live/position: not finite (1, first 7)"),
        ("intensity", 3, 1.5, "/live/intensity: outside 0 to 1 (1, first 3)"),
        ("stamp", 1, np.inf, "/live/stamp: not finite (1, first 1)"),
    ],
)
def test_values_that_a_live_run_cannot_have_are_found_by_check(tmp_path, name, row, value, sentence):
    given = live_run(3)
    given["live_arrays"][name][row] = value
    write_file(tmp_path / "a.h5", make_contours(3), **given)
    assert check_file(tmp_path / "a.h5") == [sentence]


def test_the_writer_refuses_arrays_that_contradict_the_description_and_resumes_with_all_of_them(tmp_path):
    given, contours = live_run(3), make_contours(3)
    given["live"]["samples"] = 8
    with pytest.raises(ContourFileError, match="/live/mark has 9 rows, expected 8"):
        write_file(tmp_path / "a.h5", contours, **given)
    header = write_file(tmp_path / "b.h5", contours, **live_run(3))
    ContourWriter(tmp_path / "c.h5", header).close()
    write_file(tmp_path / "c.h5", contours, mode="resume", **live_run(3))
    assert check_file(tmp_path / "c.h5") == []
