"""Live runs and sessions with a stratos: what the model of its bridge was handed is what was drawn."""

import numpy as np
import pytest
from bridge_cases import ScriptedBridge, ServedModel

from palpate.device import array_model
from palpate.render import (
    DriveStrategy,
    Live,
    LiveRecording,
    LiveStimulus,
    PlacedArray,
    SamplingStrategy,
    Session,
    Stimulus,
    render,
    static_pose,
)
from palpate.render.errors import StrategyError


def values_of(samples, foci=1):
    return np.array([np.frombuffer(sample, "<f4") for sample in samples]).reshape(-1, foci, 4)


def are_in_order(part, whole):
    """Whether samples stand in a list one after the other, with others between them or not."""
    rest = iter(whole)
    return all(any(own == other for other in rest) for own in part)


@pytest.mark.exhaustive
def test_a_live_run_hands_over_the_focal_points_that_it_records(tmp_path):
    served, path = ServedModel(), tmp_path / "run.h5"
    with ScriptedBridge(served) as server:
        array = [PlacedArray(array_model("stratos"), server.address)]
        with Live("tube", array=array, record=path, realtime=False, watchdog=True) as live:
            live.wait(1.5)
        assert live.outcome["off_confirmed"] is None  # its driver does not say
        assert live.outcome["arrays"][0]["off_sent"] is True
    played = served.played
    with LiveRecording(path) as recording:
        focus, mark = recording.focal_points(), recording.mark
        assert recording.compare().differing == 0
    drawn = np.column_stack([focus.position, focus.intensity]).astype("<f4")
    drawn = [own.tobytes() for own in drawn[(mark == 0) & (np.asarray(focus.intensity) > 0)]]
    # a sample that came late is faded by the writer: it stands where one was drawn, at a level of its own
    heard = [sample for sample in played if values_of([sample])[0, 0, 3] > 0]
    sounding = [sample for sample in heard if sample in set(drawn)]
    # what was drawn before the writer had begun, and what waited when the run ended, was not played, and is not marked
    first, stop = drawn.index(sounding[0]), len(drawn) - drawn[::-1].index(sounding[-1])
    assert stop - first > 20
    assert are_in_order(drawn[first:stop], sounding)
    places = {own[:12] for own in drawn}  # what was held or faded, where a sample came late, stands where one was drawn
    assert {own[:12] for own in heard} <= places
    assert values_of(played[-1:])[0, 0, 3] == 0
    assert served.model.intensity == 0


@pytest.mark.exhaustive
def test_a_session_of_four_focal_points_hands_over_each_stimulus_between_silence(tmp_path):
    contours = render("cube", "palm", static_pose([0, 0, 0.2]), "cc")
    path = contours.save(tmp_path / "cube.h5")
    sampling = SamplingStrategy(foci=4, update_rate=10e3)
    served = ServedModel()
    with ScriptedBridge(served) as server:
        array = [PlacedArray(array_model("stratos"), server.address)]
        with Session(array, foci=4, lead=0.05, realtime=False) as session:
            stored, live = session.load(
                [Stimulus(path, sampling=sampling, duration=0.3), LiveStimulus("tube", duration=0.3, sampling=sampling)]
            )
            onset = session.play(stored)
            assert session.wait(5.0)
            count = len(served.played)
            session.play(live)
            assert session.wait(5.0)
        assert onset.is_estimate  # a bridge does not say when a sample began
    values = values_of(served.played, foci=4)
    focus = contours.sample(sampling, duration=0.3).focus
    wanted = [own.tobytes() for own in np.asarray(focus.position, "<f4")]
    sounding = values[:count][values[:count, :, 3].any(axis=1)]
    assert len(sounding) > 1000
    assert {own.tobytes() for own in np.ascontiguousarray(sounding[:, :, :3])} <= set(wanted)
    assert not values[0, :, 3].any()
    assert not values[-1, :, 3].any()
    assert values[count:, :, 3].any()
    assert served.model.intensity == 0


def test_a_watchdog_for_an_emulated_one_and_what_it_cannot_be_told_are_refused_before_anything_is_started(monkeypatch):
    monkeypatch.setattr("palpate.device.live.writer_handle.subprocess.Popen", None)
    with pytest.raises(StrategyError, match="a watchdog is for real arrays"):
        Live("tube", array="stratos", emulate=True, watchdog=True)
    both = [PlacedArray(array_model(name)) for name in ("stratos", "emulator")]
    for start in (lambda: Live("tube", array=both, emulate=True), lambda: Session(both, emulate=True)):
        with pytest.raises(StrategyError, match="array stratos plays alone"):
            start()
    for drive, field in ((DriveStrategy(slew=0.01), "slew"), (DriveStrategy(solver="wgs"), "solver")):
        with pytest.raises(StrategyError, match=rf"{field} is .* but array stratos takes focal points"):
            Live("tube", array="stratos", drive=drive, emulate=True)
