"""What a run recorded: marks lie where frames were skipped, times count from the first sample."""

import numpy as np
import pytest

from palpate.datasets.motions.hand_motion import PALM_DOWN
from palpate.render import Palm, SamplingStrategy
from palpate.render.errors import StrategyError
from palpate.render.intersection.named_inputs import solid_of
from palpate.render.live.drawn_log import LoggedPoints, LoggedPose
from palpate.render.live.recorder import SegmentRecorder, record_path
from palpate.render.live.recording import DROPPED, EMITTED, FADED
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


def segment(records, *, began=True, began_ns=None, skipped=(), events=()):
    rendering = LiveRendering(
        solid=solid_of("cube"),
        hand=Palm(),
        strategy=strategy_of("cc"),
        sampling=SamplingStrategy(update_rate=10e3),
        drive=DriveStrategy(),
    )
    own = SegmentRecorder(rendering)
    for record in records:
        own.add(record)
    if began:
        own.begin(BASE, START_NS)
    fields = {"source": "exploration", "array": "emulator", "lead": 6e-3, "realtime": False, "emission": "board"}
    return own.made(began_ns or {}, list(skipped), list(events), **fields)


RECORDS = [pose(0, 7, -4), points(0, 40), pose(40, 8, 1), points(40, 60, gain=0.5)]


def test_times_count_from_sample_0_and_marks_lie_where_frames_were_skipped():
    made = segment(
        RECORDS,
        began_ns={7: ORIGIN_NS + 2 * MS, 99: 0},
        skipped=[[BASE - 10, 15, DROPPED], [BASE + 90, 30, FADED], [BASE - 30, 10, DROPPED]],
        events=[(ORIGIN_NS * 1e-9 + 0.5, "change", "cube")],
    )
    np.testing.assert_allclose(made.time, [0, 4e-3])
    np.testing.assert_allclose(made.stamp, [-4e-3, 1e-3], atol=1e-9)
    np.testing.assert_allclose(made.emitted, [2e-3, np.nan], atol=1e-9)
    assert made.position.shape == (100, 3)
    assert made.mark.tolist() == [DROPPED] * 5 + [EMITTED] * 85 + [FADED] * 10
    assert made.gain.tolist() == [1.0] * 40 + [0.5] * 60
    assert made.events[0][0] == pytest.approx(0.5, abs=1e-6)


def test_without_a_gain_there_is_none_and_without_poses_nothing():
    assert segment(RECORDS[:2]).gain is None
    assert segment([]) is None
    assert segment(RECORDS, began=False) is None


def test_a_recording_that_cannot_be_written_is_refused_before_the_run(tmp_path):
    (tmp_path / "there.h5").write_bytes(b"")
    for name, sentence in {
        "run.txt": r"must end in \.h5 or \.hdf5",
        "there.h5": "exists already; overwrite=True",
        "no/run.h5": "there is no folder",
    }.items():
        with pytest.raises(StrategyError, match=sentence):
            record_path(tmp_path / name, overwrite=False)
    assert record_path(tmp_path / "there.h5", overwrite=True) == tmp_path / "there.h5"
