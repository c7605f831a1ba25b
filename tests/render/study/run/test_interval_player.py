"""Stimuli of a study on the emulated array: outcome, onset, and what was drawn."""

import math
import threading
import time

import pytest
from gated_hand import GatedHand
from study_plans import study

from palpate.datasets.errors import ContourFileError
from palpate.device import array_model
from palpate.render import Session, render, static_pose, summarise
from palpate.render.study.plan.stimulus_judgement import judge_stimuli
from palpate.render.study.plan.study_plan import PlannedStimulus
from palpate.render.study.run.interval_player import PLAYED, IntervalPlayer, drawn_interval


def test_a_file_that_is_no_recording_is_named(tmp_path):
    path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "cube.h5")
    with pytest.raises(ContourFileError, match=r"cube\.h5: it is no recording of a live rendering"):
        drawn_interval(path)


@pytest.mark.exhaustive
def test_stored_and_live_stimuli_begin_in_milliseconds_and_say_what_was_drawn(tmp_path):
    file = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "cube.h5")
    plan = study(
        stimuli=(
            PlannedStimulus(name="tube-cc", duration=0.5, solid="tube", strategy="cc"),
            PlannedStimulus(name="tube-oc", duration=0.5, solid="tube", strategy="oc"),
            PlannedStimulus(name="cube", duration=0.3, file=file),
        ),
        blocks=(),
    )
    solids = {}
    found = judge_stimuli(plan, array_model("emulator"), solids=solids)
    assert found.faults == []
    with Session("emulator", update_rate=found.update_rate, realtime=False) as session:
        player = IntervalPlayer(session, plan, solids)
        for number, name in enumerate(["tube-cc", "cube", "tube-oc", "tube-cc", "cube"]):
            begun, path = [], tmp_path / f"{number}.h5"
            called = time.monotonic()
            own = player.play(
                name, poses_file=path, is_held=lambda: False, begun=begun.append, waits_for_hand=lambda: None
            )
            assert own.outcome == PLAYED
            assert begun[0].time == own.onset >= called
            assert own.latency > 0
            duration = 0.3 if name == "cube" else 0.5
            assert own.ended - own.onset > duration - 0.05
            assert (own.poses_file == path) is (name != "cube")
            player.save_poses()
            assert (player.drawn(own) is None) is (own.poses_file is None)
            if own.poses_file is not None:
                drawn, whole = player.drawn(own), summarise(path)
                assert drawn.poses == whole["poses"] > 20
                assert drawn.length_mean == pytest.approx(whole["length_mean"])
                assert (drawn.r is None) is (name == "tube-oc" or whole["r"] is None)
                if drawn.r is not None:
                    assert drawn.r == pytest.approx(whole["r"])
                    assert 1 <= drawn.r_open <= drawn.r
        held = time.monotonic() + 0.2
        own = player.play(
            "tube-cc", poses_file=None, is_held=lambda: time.monotonic() > held, begun=lambda onset: None,
            waits_for_hand=lambda: None,
        )  # fmt: skip
        assert own.outcome.startswith("stopped after 0.")
        own = player.play(
            "cube", poses_file=None, is_held=lambda: True, begun=lambda onset: None, waits_for_hand=lambda: None
        )
        assert (own.outcome, own.onset) == ("stopped before it began", None)


@pytest.mark.exhaustive
def test_a_stimulus_that_waits_for_a_hand_is_cancelled_and_begins_whenever_the_hand_comes(tmp_path):
    gate = tmp_path / "hand"
    plan = study(stimuli=(PlannedStimulus(name="cube", duration=0.3, solid="cube", strategy="cc"),), blocks=())
    solids = {}
    judge_stimuli(plan, array_model("emulator"), solids=solids)
    with Session("emulator", source=GatedHand(gate), realtime=False) as session:
        player = IntervalPlayer(session, plan, solids)

        def play(number, *, held_after=math.inf, hand_after=math.inf):
            gate.unlink(missing_ok=True)
            time.sleep(0.2)
            began, asked = time.monotonic(), []
            if math.isfinite(hand_after):
                threading.Timer(hand_after, gate.touch).start()
            own = player.play(
                "cube", poses_file=tmp_path / f"{number}.h5", is_held=lambda: time.monotonic() > began + held_after,
                begun=lambda onset: None, waits_for_hand=lambda: asked.append(time.monotonic() - began),
            )  # fmt: skip
            player.save_poses()
            return own, began, asked

        own, began, asked = play(0, held_after=0.2, hand_after=2.0)
        assert (own.outcome, own.onset) == ("stopped before it began", None)
        assert time.monotonic() - began < 2.0  # before the hand came
        assert session.statistics().frames_on == 0
        time.sleep(2.0)
        for number, late in enumerate((0.97, 0.99, 1.0, 1.01, 1.03, 1.6), 1):  # around the time of the sentence
            own, began, asked = play(number, hand_after=late)
            assert own.outcome == PLAYED
            assert own.onset - began > late
            assert own.poses_file.exists()
            assert len(asked) <= 1
        assert asked[0] > 0.95  # the participant was asked for a hand
