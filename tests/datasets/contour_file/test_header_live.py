"""The live run of a file: its description is read back, and arrays that contradict it are found and named."""

import numpy as np
import pytest
from contour_cases import assert_whole, finish, live_run, make_contours, make_header, write_file, write_ranges

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.header_live import RecordedRun, require_live
from palpate.datasets.contour_file.live_summary import summarise_run
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError
from palpate.datasets.storage.schema import LIVE

ROWS = {"stamp": 3, "emitted": 3, "position": 18, "intensity": 18, "mark": 9, "events": 40}
RUN = live_run(3)["live"]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.h5"


def test_a_live_run_is_resumed_read_back_in_parts_and_summed_up(path):
    given, contours = live_run(3), make_contours(3)
    with ContourWriter(path, make_header(3, **given)) as writer:
        write_ranges(writer, contours, [(0, 1)])
    assert finish(path, contours, **given) == ([(1, 3)], ())
    with ContourFile(path) as file:
        assert file.live_run == RecordedRun.from_json(RUN)
        assert file.live_run.duration == 0.09
        for name, rows in given["live_arrays"].items():
            np.testing.assert_array_equal(file.live_rows(name), rows, strict=True)
            np.testing.assert_array_equal(file.live_rows(name, 1, 3), rows[1:3], strict=True)
        summary = summarise_run(file)
    assert summary["latency_p50"] == summary["latency_max"] == pytest.approx(1.0 - 2 / 90 + 0.006)
    assert (summary["poses"], summary["poses_emitted"], summary["seconds_dropped"]) == (3, 1, 1)
    assert [summary[name] for name in ("emitted", "dropped", "held", "faded")] == [3, 2, 2, 2]


def test_a_live_run_of_which_no_emission_is_known_has_no_latency(path):
    given = live_run(3)
    given["live_arrays"]["emitted"] = np.full(3, np.nan)
    del given["live_arrays"]["gain"]
    write_file(path, make_contours(3), **given)
    assert_whole(path, make_contours(3))
    with ContourFile(path) as file:
        assert summarise_run(file)["latency_p99"] is None
        assert not file.has_live("gain")


def test_a_file_of_no_live_run_has_none(path):
    write_file(path, make_contours(3))
    with ContourFile(path) as file:
        assert file.live_run is summarise_run(file) is None
        assert not any(file.has_live(spec.name) for spec in LIVE)


BAD_RUNS = {
    "hold": (float("nan"), "hold must be a finite number above 0, not nan"),
    "update_rate": (0, "update_rate must be a finite number above 0, not 0"),
    "samples": (9.0, "samples must be a whole number of 1 or more, not 9.0"),
    "foci": (True, "foci must be a whole number of 1 or more, not True"),
    "realtime": (1, "realtime must be of type bool, not 1"),
    "source": (None, "source must be of type str, not None"),
    "sampling": ("stm", "sampling must be a JSON object, not 'stm'"),
}


def test_a_description_with_a_wrong_value_is_refused_by_name():
    for name, (value, sentence) in BAD_RUNS.items():
        with pytest.raises(ContourFileError, match=sentence):
            require_live(RUN | {name: value}, ROWS, 3)
        with pytest.raises(ContourFileError, match=f"its attribute run has no '{name}'"):
            require_live({key: own for key, own in RUN.items() if key != name}, ROWS, 3)


def test_arrays_that_are_missing_or_of_another_number_of_rows_are_found():
    require_live(RUN, ROWS, 3)
    for name, count in ROWS.items():
        with pytest.raises(ContourFileError, match=f"/live/{name} is missing"):
            require_live(RUN, {key: own for key, own in ROWS.items() if key != name}, 3)
        if name != "events":
            with pytest.raises(ContourFileError, match=f"/live/{name} has {count + 1} rows, expected {count}"):
                require_live(RUN, ROWS | {name: count + 1}, 3)
        with pytest.raises(ContourFileError, match=f"/live/{name} is there, but /live has no attribute run"):
            require_live(None, {name: 3}, 3)


def test_values_that_a_live_run_cannot_have_are_found_by_check(path):
    given = live_run(3)
    wrong = [
        ("mark", 4, 4, "/live/mark: outside 0 to 3 (1, first 4)"),
        ("gain", 2, -0.5, "/live/gain: below 0 (1, first 2)"),
        ("position", (7, 1), np.nan, "/live/position: not finite (1, first 7)"),
        ("intensity", 3, 1.5, "/live/intensity: outside 0 to 1 (1, first 3)"),
        ("stamp", 1, np.inf, "/live/stamp: not finite (1, first 1)"),
    ]
    for name, row, value, _ in wrong:
        given["live_arrays"][name][row] = value
    write_file(path, make_contours(3), **given)
    assert sorted(check_file(path)) == sorted(sentence for *_, sentence in wrong)
    given["live"]["samples"] = 8
    with pytest.raises(ContourFileError, match="/live/mark has 9 rows, expected 8"):
        write_file(path, make_contours(3), **given)
