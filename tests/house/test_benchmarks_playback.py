"""Every case of the playback benchmark runs, small, and tells what it should."""

import sys
from pathlib import Path

import pytest
from umockdev_session import missing

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from playback import CASES, first_frame_of_file, line, measure, prepared_costs


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.label)
def test_playback_case_tells_its_figures(case):
    if case.bus == "umockdev" and missing():
        pytest.skip(missing())
    figures = measure(case, seconds=0.3, stops=1)
    assert figures["bytes"] == round(0.3 * case.update_rate / 128) * 128 * 512
    assert figures["transport"] == case.transport
    assert figures["board_underruns"] is not None
    assert len(figures["stop_latency"]) == 1
    assert min(figures["rate"], figures["cpu"], figures["first_byte"], figures["stop_latency"][0]) > 0
    assert "MB/s" in line(figures)


@pytest.mark.exhaustive
def test_first_frame_of_a_file_is_timed():
    figures = first_frame_of_file(200)
    assert 0 < figures["first"] < figures["bytes"]
    assert figures["later"] > 0


@pytest.mark.exhaustive
def test_prepared_frames_cost_less_than_contours():
    figures = prepared_costs("emulator", seconds=2.0, rounds=1)
    assert figures["frames"] == 20_000
    assert 0 < figures["copied"] < figures["made"]
    assert 0 < figures["frames_played"] < figures["contours_played"]
