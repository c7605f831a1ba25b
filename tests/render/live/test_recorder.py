"""What a run recorded: marks lie where frames were skipped, times count from the first sample."""

import numpy as np
import pytest

from palpate.datasets.errors import ContourFileError
from palpate.datasets.motions.hand_motion import PALM_DOWN
from palpate.render import Palm, SamplingStrategy
from palpate.render.errors import StrategyError
from palpate.render.intersection.named_inputs import solid_of
from palpate.render.live.drawn_log import LoggedPoints, LoggedPose
from palpate.render.live.recorder import RunRecorder, record_path, spool_folder
from palpate.render.live.recording import DROPPED, EMITTED, FADED, LiveRecording
from palpate.render.live.renderer_process import LiveRendering
from palpate.render.playback.drive import DriveStrategy
from palpate.render.strategies.intersection_strategy import strategy_of

MS = 1_000_000
START_NS = 1_000_000_000_000
BASE = 500  # of this rendering's sample 0, in the ring
ORIGIN_NS = START_NS + BASE * 100_000


def pose(first, number, stamp_ms):
    row = np.array([0.001 * number, 0, 0.2, *PALM_DOWN], np.float32)
    return LoggedPose(first, number, ORIGIN_NS + stamp_ms * MS, row, None)


def points(first, count, gain=None):
    position = np.full((count, 1, 3), first, np.float32)
    own = None if gain is None else np.full(count, gain, np.float32)
    return LoggedPoints(first, position, np.ones((count, 1), np.float32), own)


RENDERING = LiveRendering(
    solid=solid_of("cube"),
    hand=Palm(),
    strategy=strategy_of("cc"),
    sampling=SamplingStrategy(update_rate=10e3),
    drive=DriveStrategy(),
)
FIELDS = {"source": "exploration", "array": "emulator", "lead": 6e-3, "realtime": False, "emission": "board"}


def saved(folder, records, *, began=True, rows=(), skipped=(), events=()):
    """The file of one rendering, whose numbers are below 90; None where there is none."""
    recorder = RunRecorder(folder / "run.h5", overwrite=False, **FIELDS)
    own = recorder.segment(RENDERING, range(90))
    for event in events:
        recorder.add_event(*event)
    for record in records[:1]:
        recorder.add(own, record)  # before its first sample has a number
    if began:
        recorder.begin(own, BASE, START_NS)
    for record in records[1:]:
        recorder.add(own, record)
    recorder.add_poses([list(row) for row in rows])
    recorder.add_skipped([list(row) for row in skipped])
    paths = recorder.save()
    assert not spool_folder(folder / "run.h5").exists()
    return paths[0] if paths else None


RECORDS = [pose(0, 7, -4), points(0, 40), pose(40, 8, 1), points(40, 60, gain=0.5)]


def test_times_count_from_sample_0_and_marks_lie_where_frames_were_skipped(tmp_path):
    path = saved(
        tmp_path,
        RECORDS,
        rows=[(7, 0, ORIGIN_NS + 2 * MS), (99, 0, 0)],
        skipped=[[BASE - 10, 15, DROPPED], [BASE + 90, 30, FADED], [BASE - 30, 10, DROPPED]],
        events=[(ORIGIN_NS * 1e-9 + 0.5, "change", "cube")],
    )
    with LiveRecording(path) as made:
        np.testing.assert_allclose(made.time, [0, 4e-3])
        np.testing.assert_allclose(made.stamp, [-4e-3, 1e-3], atol=1e-9)
        np.testing.assert_allclose(made.emitted, [2e-3, np.nan], atol=1e-9)
        assert made.run.samples == 100
        assert made.mark.tolist() == [DROPPED] * 5 + [EMITTED] * 85 + [FADED] * 10
        assert made.gain.tolist() == [1.0] * 40 + [0.5] * 60
        assert made.events[0][0] == pytest.approx(0.5, abs=1e-6)


def test_without_a_gain_there_is_none_and_without_poses_no_file(tmp_path):
    with LiveRecording(saved(tmp_path, RECORDS[:2])) as made:
        assert made.gain is None
    for name, records, began in (("a", [], True), ("b", RECORDS, False)):
        (tmp_path / name).mkdir()
        assert saved(tmp_path / name, records, began=began) is None


def test_a_full_disk_ends_the_record_and_is_raised_at_its_end(tmp_path, monkeypatch):
    recorder = RunRecorder(tmp_path / "run.h5", overwrite=False, **FIELDS)
    own = recorder.segment(RENDERING, range(90))
    recorder.begin(own, BASE, START_NS)
    for record in RECORDS[:2]:
        recorder.add(own, record)

    def full(*_):
        raise ContourFileError("no space left on device")

    monkeypatch.setattr(own.spool, "add_pose", full)
    recorder.add(own, RECORDS[2])
    recorder.add(own, RECORDS[3])
    with pytest.raises(ContourFileError, match="no space left"):
        recorder.save()
    with LiveRecording(tmp_path / "run.h5") as made:  # what was there before is not lost
        assert (len(made.time), made.run.samples) == (1, 40)


def test_a_recording_that_cannot_be_written_is_refused_before_the_run(tmp_path):
    (tmp_path / "there.h5").write_bytes(b"")
    spool_folder(tmp_path / "killed.h5").mkdir()
    for name, sentence in {
        "run.txt": r"must end in \.h5 or \.hdf5",
        "there.h5": "exists already; overwrite=True",
        "no/run.h5": "there is no folder",
        "killed.h5": r"killed\.h5\.live: a run that was killed left it.*--finish",
    }.items():
        with pytest.raises(StrategyError, match=sentence):
            record_path(tmp_path / name, overwrite=False)
    assert record_path(tmp_path / "there.h5", overwrite=True) == tmp_path / "there.h5"
