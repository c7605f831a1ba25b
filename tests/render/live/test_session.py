"""A session: stimuli that are loaded once, and each on the emulated array within milliseconds of its call."""

import os
import signal
import time

import pytest

from palpate.device.errors import DeviceBusyError, DeviceError, DeviceTimeoutError
from palpate.render import (
    LiveRecording,
    LiveStimulus,
    Onset,
    SamplingStrategy,
    Session,
    Stimulus,
    prepare_frames,
    render,
    static_pose,
)
from palpate.render.errors import RenderError, StrategyError
from palpate.render.live import session as module


@pytest.fixture
def path(tmp_path):
    return render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "cube.h5")


@pytest.mark.exhaustive
def test_stored_and_live_stimuli_are_played_one_after_the_other(path, tmp_path):
    prepared = prepare_frames(path, tmp_path / "frames.h5", duration=0.1)
    assert prepared
    with Session(realtime=False) as session:
        live = LiveStimulus("tube", duration=0.3)
        numbers = session.load([Stimulus(path, duration=0.1), live, tmp_path / "frames.h5"])
        assert numbers == [0, 1, 2]
        assert "3 stimuli at 10000 Hz" in repr(session)
        for number in (0, 2, 1, 0, 1):
            onset = session.play(number, repeats=1)
            assert (session.moment() is not None) is (number == 1)  # stored stimuli have no pose
            assert isinstance(onset, Onset)
            assert 0 < onset.latency < (0.2 if number == 1 else 0.05)
            assert not onset.is_estimate
            with pytest.raises(DeviceBusyError, match=f"stimulus {number} plays"):
                session.play(0)
            assert session.wait(2.0)
            duration = time.monotonic() - onset.time
            assert 0.05 < duration < 0.3 + 0.3
        assert session.statistics().poses > 20
        with pytest.raises(StrategyError, match="live stimuli are loaded in one call"):
            session.load([live])
        with pytest.raises(StrategyError, match=r"number must be one of the 3 stimuli.*not 3"):
            session.play(3)
        with pytest.raises(StrategyError, match="repeats must be"):
            session.play(0, repeats=0)
    session.close()  # twice is once
    with pytest.raises(DeviceError, match="not held any more"):
        session.play(0)


@pytest.mark.exhaustive
def test_a_stimulus_of_another_rate_or_too_many_bytes_is_refused_and_the_others_play(path, monkeypatch):
    with Session(realtime=False) as session:
        other = SamplingStrategy(update_rate=20e3)
        with pytest.raises(StrategyError, match="update_rate is 20000 Hz, but this session's array runs at 10000 Hz"):
            session.load([Stimulus(path, duration=0.1), Stimulus(path, sampling=other, duration=0.1)])
        with pytest.raises(StrategyError, match="update_rate is 20000 Hz"):
            session.load([LiveStimulus("cube", 1.0, sampling=other)])
        with pytest.raises(StrategyError, match="must have the same hand"):
            session.load([LiveStimulus("cube", 1.0), LiveStimulus("cube", 1.0, hand="skin")])
        with monkeypatch.context() as patch:
            patch.setattr(module, "BYTES_MOST", 1000)
            with pytest.raises(StrategyError, match="may have 1,000 bytes of frames; a shorter duration"):
                session.load([Stimulus(path, duration=0.1)])
        assert session.stimuli == ()
        assert (session.scene(), session.moment()) == (None, None)
        (number,) = session.load([Stimulus(path, sampling="stm", duration=0.1)])
        with pytest.raises(StrategyError, match="record is for live stimuli"):
            session.play(number, record="x.h5")
        session.play(number)
        assert session.wait(2.0)


@pytest.mark.exhaustive
def test_a_stimulus_is_stopped_at_any_moment_and_the_next_one_plays(path):
    with Session(realtime=False) as session:
        stored, live = session.load([Stimulus(path, duration=5.0), LiveStimulus("tube", duration=5.0)])
        for number in (stored, live, stored, live):
            session.play(number)
            time.sleep(0.05)
            assert session.wait(0.0) is False
            began = time.monotonic()
            session.stop()
            assert time.monotonic() - began < 0.5
            assert session.wait(0.0) is True
            session.stop()  # nothing plays: nothing happens


@pytest.mark.exhaustive
def test_a_live_stimulus_is_recorded(tmp_path):
    record = tmp_path / "felt.h5"
    with Session(realtime=False) as session:
        tube, cube = session.load([LiveStimulus("tube", duration=0.2), LiveStimulus("cube", duration=0.3)])
        session.play(tube)
        session.wait()
        with pytest.raises(StrategyError, match="must end in"):
            session.play(cube, record=tmp_path / "felt.txt")
        session.play(cube, record=record)
        assert session.moment().scene is session.scene()
        assert session.scene().object_name == "cube"
        session.wait()
        with pytest.raises(StrategyError, match="exists already"):
            session.play(cube, record=record)
    with LiveRecording(record) as recording:
        assert recording.compare().differing == 0
        assert 0.25 < recording.run.samples / 10e3 < 0.4


@pytest.mark.exhaustive
def test_without_a_hand_a_live_stimulus_does_not_begin():
    with Session(source="udp:127.0.0.1:0", realtime=False) as session:
        (live,) = session.load([LiveStimulus("tube", duration=1.0)])
        with pytest.raises(DeviceTimeoutError, match=r"did not begin within 0\.3 s: no pose came from the source"):
            session.play(live, timeout=0.3)
        assert session.wait(0.0)  # nothing plays


@pytest.mark.exhaustive
def test_a_process_that_is_killed_is_an_error_of_what_is_called_next(path):
    session = Session(realtime=False)
    (live,) = session.load([LiveStimulus("tube", duration=5.0)])
    session.play(live)
    os.kill(session._run._renderer.process_id, signal.SIGKILL)
    with pytest.raises(RenderError, match="process that draws ended"):
        session.wait(5.0)
    with pytest.raises(RenderError, match="process that draws ended"), session:
        pass
    assert session._held.outcome["off_confirmed"] is True


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"prediction": 5.0}, "horizon"),
        ({"clock": "virtual"}, "clock=virtual is not for live runs"),
    ],
)
def test_bad_input_is_refused_before_anything_is_started(fields, sentence, monkeypatch):
    monkeypatch.setattr("palpate.render.live.held_arrays.WriterHandle", None)
    with pytest.raises(Exception, match=sentence) as refused:
        Session(**fields)
    assert type(refused.value).__module__.startswith("palpate.")
