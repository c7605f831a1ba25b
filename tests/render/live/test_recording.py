"""The file of a live run: rendering and sampling its poses gives the focal points of the run, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import answer, run
from contour_cases import make_contours, write_file
from live_cases import RATE, regular, run_live

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.errors import ContourFileError
from palpate.datasets.focus_files.ptlist import read_ptlist
from palpate.render import play_file
from palpate.render.live.recording import (
    DROPPED,
    EMITTED,
    FADED,
    HELD,
    LiveComparison,
    LiveRecording,
    save_segment,
)
from palpate.render.playback.focal_points import open_focal_points
from palpate.render.playback.placed_arrays import arrays_of
from palpate.render.reports.file_summary import summarise
from palpate.render.sampling.strategy import AmplitudeModulation, SamplingStrategy

GAP = np.append(regular(90, 8), regular(90, 8) + 6000)  # tracking is lost for half a second
RUNS = {
    "slower than expected, longer at the end": {"first": regular(4, 4), "interval": 1 / 90, "last": 4000},
    "a gap": {"first": GAP},
    "a gap, fading slowly": {"first": GAP, "sampling": SamplingStrategy(hold=0.05, fade=0.2)},
    "90 Hz, jitter": {"first": regular(90, 30, 0.008)},
    "60 Hz, jitter": {"first": regular(60, 20, 0.01)},
    "120 Hz, jitter": {"first": regular(120, 40, 0.006)},
    "2 samples apart": {"first": np.arange(40) * 2},
    "a last pose without a sample": {"first": regular(90, 4), "last": 0},
    "one pose": {"first": [0], "last": 2500},
    "three foci": {"first": GAP, "sampling": SamplingStrategy(foci=3, am=AmplitudeModulation())},
}


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("run", RUNS.values(), ids=RUNS)
def test_each_sample_of_a_run_is_given_again_bit_for_bit(run, tmp_path):
    segment = run_live(**run)
    with LiveRecording(save_segment(tmp_path / "run.h5", segment)) as recording:
        assert recording.compare() == LiveComparison(len(segment.intensity), 0, None)
        np.testing.assert_array_equal(recording.position, segment.position, strict=True)
        np.testing.assert_array_equal(recording.intensity, segment.intensity, strict=True)
    assert check_file(tmp_path / "run.h5") == []


def test_everything_of_a_run_is_read_back(tmp_path):
    segment = run_live(regular(90, 6))
    count = len(segment.intensity)
    segment.mark[10:13], segment.mark[20:25], segment.mark[-7:] = DROPPED, HELD, FADED
    segment = replace(segment, gain=np.full(count, 0.5, np.float32), emitted=segment.time + np.nan)
    segment.emitted[1:4] = segment.time[1:4] + np.array([0.001, 0.002, 0.003])
    with LiveRecording(save_segment(tmp_path / "run.h5", segment)) as recording:
        for name in ("time", "pose", "patch_pose", "stamp", "emitted", "gain", "mark", "events"):
            np.testing.assert_array_equal(getattr(recording, name), getattr(segment, name), err_msg=name)
        assert recording.sampling == segment.sampling
        assert recording.run == segment.run()
        assert recording.latency[1:4] == pytest.approx([0.007, 0.008, 0.009])
        summary = recording.summary()
    assert (summary["latency_p50"], summary["latency_max"]) == pytest.approx((0.008, 0.009))
    assert {name: summary[name] for name in ("emitted", "dropped", "held", "faded")} == {
        "emitted": count - 15, "dropped": 3, "held": 5, "faded": 7
    }  # fmt: skip
    assert (summary["poses_emitted"], summary["seconds_dropped"]) == (3, 1)
    assert summarise(tmp_path / "run.h5")["live"] == summary
    assert EMITTED == 0


@pytest.mark.parametrize(("name", "sample"), [("position", 77), ("intensity", 80)])
def test_a_single_bit_that_differs_is_found(tmp_path, name, sample):
    segment = run_live(regular(90, 3))
    bits = getattr(segment, name).view(np.uint32)
    bits[sample] ^= np.uint32(1)
    with LiveRecording(save_segment(tmp_path / "run.h5", segment)) as recording:
        comparison = recording.compare()
    assert comparison == LiveComparison(len(segment.intensity), 1, sample)
    assert repr(comparison) == f"LiveComparison(1 of {len(segment.intensity)} samples differ, from sample {sample} on)"


@pytest.mark.exhaustive
@pytest.mark.parametrize("run", ["slower than expected, longer at the end", "one pose", "a gap"])
def test_a_playback_without_a_sampling_draws_what_the_run_drew(tmp_path, run):
    segment = run_live(**RUNS[run])
    path = save_segment(tmp_path / "run.h5", segment)
    with open_focal_points(path, None, None, arrays_of("emulator")) as (source, _):
        position, intensity = (np.concatenate(part) for part in zip(*source, strict=True))
        assert source.frame_count == len(intensity)
    np.testing.assert_array_equal(position, segment.position, strict=True)
    np.testing.assert_array_equal(intensity, segment.intensity, strict=True)
    assert play_file(path, clock="virtual").frames == len(intensity)
    assert play_file(path, sampling="stm", duration=0.01, clock="virtual").frames == 100


def test_another_contour_file_is_no_live_recording_and_a_file_stays_unless_it_may_be_replaced(tmp_path):
    segment = run_live(regular(90, 3))
    path = save_segment(tmp_path / "run.h5", segment)
    with pytest.raises(ContourFileError, match="exists already"):
        save_segment(path, segment)
    save_segment(path, segment, overwrite=True)
    with ContourFile(path) as file:
        assert file.live_run == segment.run()
    write_file(plain := tmp_path / "plain.h5", make_contours(1))
    with pytest.raises(ContourFileError, match=r"plain\.h5 is a contour file, but not the recording of a live run"):
        LiveRecording(plain)


@pytest.mark.exhaustive
def test_commands_take_the_recording_as_any_contour_file(tmp_path):
    segment = run_live(GAP)
    segment.mark[:3] = DROPPED
    path, count = save_segment(tmp_path / "run.h5", segment), len(segment.intensity)
    info = run("info", path).output
    assert f"latency p50 7.0 ms, p99 7.0 ms, 3 of {count} samples were not played as drawn" in " ".join(info.split())
    assert answer("info", path)["live"]["dropped"] == 3
    assert answer("check", path)["whole"]
    assert answer("play", path, "--clock", "virtual")["frames"] == count
    assert answer("play", path, "--clock", "virtual", "--update-rate", 20_000)["frames"] == 2 * count
    assert answer("prepare", path, "-o", tmp_path / "frames.h5")["frames"] == count
    assert answer("noise", path)["files"][0]["duration"] == count / RATE
    assert answer("view", path, "--export", tmp_path / "page.html")["poses"] == [len(GAP)]
    assert answer("render", "tube", path, "-o", tmp_path / "again.h5")["poses"] == len(GAP)
    answer("export", path, "-o", tmp_path / "points.ptlist")
    points = read_ptlist(tmp_path / "points.ptlist")
    np.testing.assert_array_equal(points.position, segment.position)
    assert points.update_rate == RATE
