"""A participant's whole way, without an array: what is shown, played, stored, and what happens where it stops."""

import sqlite3
import time
from contextlib import contextmanager
from dataclasses import replace

import pytest
from scripted_participant import ScriptedParticipant, first_key
from study_plans import CONFIDENCE, EMISSIONS, TYPED, SilentPlayer, block, study
from virtual_clock import SkippingClock

from palpate.device.errors import DeviceLostError
from palpate.device.playing.limits import Limits
from palpate.render.errors import StudyError, StudyStorageError
from palpate.render.study.plan.duty_account import DutyAccount
from palpate.render.study.run import desk as desk_module
from palpate.render.study.run import study_run as module
from palpate.render.study.run.answer_store import AnswerStore
from palpate.render.study.run.desk import StudyDesk
from palpate.render.study.run.study_file import AnswerRow
from palpate.render.study.run.study_run import DECLINED, ENDED, FINISHED, StudyRun

WHOLE = study(
    welcome="Welcome",
    consent="You will feel ultrasound.",
    data_statement="We keep answers.",
    questions_before=TYPED,
    blocks=(
        block(practice=1, questions_after=(CONFIDENCE,), instruction="Explore it twice."),
        block(name="again", repetitions=1),
    ),
    questions_after=(replace(TYPED[1], name="last"),),
)


@pytest.fixture(autouse=True)
def _no_lead_in(monkeypatch):
    monkeypatch.setattr(module, "LEAD_IN", 0.0)
    monkeypatch.setattr(desk_module, "LOST_SECONDS", 30.0)  # a busy machine may keep the participant waiting


class Begun:
    """A run of a participant on a store, with a player that plays nothing."""

    def __init__(self, plan, folder, *, code="P01", resume=False, outcomes=(), clock=None):
        self.store = AnswerStore(folder, plan)
        self.desk, self.player, self.events = StudyDesk(), SilentPlayer(outcomes), []
        self.progress = self.store.begin(code, resume=resume)
        self.shown, show = [], self.desk.show
        self.desk.show = lambda *words, **fields: self.shown.append(show(*words, **fields)) or self.shown[-1]
        self.run = StudyRun(
            plan,
            code,
            store=self.store,
            progress=self.progress,
            desk=self.desk,
            player=self.player,
            account=DutyAccount(plan.limits),
            send=lambda name, **values: self.events.append((name, values)),
            file_hashes={},
            emissions=EMISSIONS,
            shown_names={"cube-oc": "cube", "cube-cc": "cube"},
            clock=clock,
        )


@contextmanager
def begun(plan, folder, **options):
    own = Begun(plan, folder, **options)
    try:
        yield own
    finally:
        own.store.close()


def rows(folder, statement):
    connection = sqlite3.connect(folder / "answers.sqlite")
    try:
        return connection.execute(statement).fetchall()
    finally:
        connection.close()


def agree(screen):
    """The second key agrees; else the first of all keys."""
    return screen.keys[-1].key if screen.keys else first_key(screen)


def test_a_whole_study_is_shown_played_and_stored_in_order(tmp_path):
    with begun(WHOLE, tmp_path) as own, ScriptedParticipant(own.desk, agree) as person:
        assert own.run.run() == FINISHED
    assert person.error is None
    texts = [screen.text for screen in person.screens if screen.kind in ("text", "question") and screen.text]
    assert texts[:4] == ["Welcome", "You will feel ultrasound.\n\nWe keep answers.", "Your age?", "Anything else?"]
    assert own.shown[-1].kind == "ended"
    answers = rows(tmp_path, "SELECT block, trial, name, is_practice FROM answers ORDER BY sequence")
    order = [name for name, *_ in answers if name not in ("before", "after")]
    counts = {"cube": 5 + 1, "again": 2}
    assert {name: order.count(name) for name in counts} == counts
    assert answers[0][:3] == ("before", -1, "consent")
    assert answers[-1][:3] == ("after", -1, "last")
    assert sum(practice for *_, practice in answers) == 1
    intervals = rows(
        tmp_path, "SELECT block, trial, attempt, interval, stimulus, outcome, onset, onset_planned FROM intervals"
    )
    assert [stimulus for *_, stimulus, _, _, _ in intervals] == own.player.played
    assert len(intervals) == 2 * 7
    assert all(row[2] == 0 and row[5] == "played" and row[6] >= row[7] for row in intervals)
    pairs = [tuple(sorted(own.player.played[k : k + 2])) for k in range(0, 14, 2)]
    assert set(pairs) == {("cube-cc", "cube-oc")}
    names = [name for name, _ in own.events]
    assert (names[0], names[-1]) == ("study_begun", "study_ended")
    assert names.count("stimulus_onset") == names.count("stimulus_ended") == 14
    assert names.count("answer") == len(answers)


def test_an_answer_means_its_option_whichever_key_gave_it(tmp_path):
    plan = study(blocks=(block(repetitions=8),))

    def second(screen):
        """The key that is called Second."""
        if screen.question is not None and screen.question.name == "answer":
            return next(own.key for own in screen.keys if own.label == "Second")
        return first_key(screen)

    with begun(plan, tmp_path) as own, ScriptedParticipant(own.desk, second):
        assert own.run.run() == FINISHED
    found = rows(tmp_path, "SELECT value, label, key, key_order, seconds FROM answers")
    assert {row[:2] for row in found} == {(1, "Second")}
    assert {row[2] for row in found} == {"ArrowLeft", "ArrowRight"}  # keys change at random
    assert {(row[2], row[3]) for row in found} == {("ArrowLeft", "[1, 0]"), ("ArrowRight", "[0, 1]")}
    assert {row[4] for row in found} == {0.25}


def test_who_declines_is_not_kept(tmp_path):
    with begun(WHOLE, tmp_path) as own, ScriptedParticipant(own.desk) as person:  # the first key declines
        assert own.run.run() == DECLINED
    assert person.error is None
    assert own.shown[-1].kind == "ended"
    assert own.player.played == []
    assert rows(tmp_path, "SELECT * FROM answers") == rows(tmp_path, "SELECT * FROM participants") == []
    with begun(WHOLE, tmp_path) as own:  # the code is free again
        assert own.progress.answers == {}


@pytest.mark.parametrize("stopped_after", range(0, 12, 2))
def test_a_run_that_was_ended_goes_on_where_it_stopped(tmp_path, stopped_after):
    whole = _answers_of(WHOLE, tmp_path / "whole")
    folder, count = tmp_path / "parts", 0

    def some(screen):
        nonlocal count
        if screen.kind == "question":
            if count == stopped_after:
                own.desk.end()
                return None
            count += 1
        return agree(screen)

    with begun(WHOLE, folder) as own, ScriptedParticipant(own.desk, some):
        assert own.run.run() == (ENDED if stopped_after < len(whole) else FINISHED)
    assert len(rows(folder, "SELECT * FROM answers")) == min(stopped_after, len(whole))
    with begun(WHOLE, folder, resume=True) as own, ScriptedParticipant(own.desk, agree) as person:
        assert own.run.run() == FINISHED
    assert _stored(folder) == whole
    shown = [screen.text for screen in person.screens if screen.kind == "question"]
    assert len(shown) == len(whole) - stopped_after
    attempts = rows(folder, "SELECT block, trial, count(DISTINCT attempt) FROM intervals GROUP BY block, trial")
    assert sum(count - 1 for *_, count in attempts) <= 1  # only the trial under way is played again


def _answers_of(plan, folder):
    with begun(plan, folder) as own, ScriptedParticipant(own.desk, agree):
        assert own.run.run() == FINISHED
    return _stored(folder)


def _stored(folder):
    return rows(
        folder, "SELECT block, trial, name, value, label, key, key_order, stimuli FROM answers ORDER BY sequence"
    )


def test_a_stop_and_a_closed_page_end_the_interval_and_the_trial_is_played_again(tmp_path):
    plan = study(blocks=(block(repetitions=1),))

    def stop():
        own.desk.stop("the experimenter stopped")
        return "stopped after 0.1 s"

    with begun(plan, tmp_path, outcomes=["played", stop]) as own, ScriptedParticipant(own.desk) as person:

        def go_on(screen):
            if screen.kind == "wait" and own.desk.is_stopped:
                own.desk.go_on()
            return first_key(screen)

        person._rule = go_on
        assert own.run.run() == FINISHED
    assert person.error is None
    outcomes = rows(tmp_path, "SELECT trial, attempt, interval, outcome FROM intervals ORDER BY sequence")
    assert [row[:3] for row in outcomes[:4]] == [(0, 0, 0), (0, 0, 1), (0, 1, 0), (0, 1, 1)]
    assert outcomes[1][3] == "stopped before it began"
    assert len(rows(tmp_path, "SELECT * FROM answers")) == 2
    events = [name for (name,) in rows(tmp_path, "SELECT name FROM events")]
    assert "stopped" in events


def test_the_array_rests_where_limits_demand_it_and_the_participant_is_told(tmp_path):
    limits = Limits(on_time_max=0.4, pause_min=0.2, duty_max=None)
    plan = study(limits=limits, blocks=(block(repetitions=1),))
    with begun(plan, tmp_path) as own, ScriptedParticipant(own.desk) as person:
        assert own.run.run() == FINISHED
    assert person.error is None
    rests = [screen for screen in own.shown if screen.kind == "rest"]
    assert len(rests) == 1  # two intervals of 10 ms may be, four may not
    assert rests[0].ends > 0
    assert [name for name, _ in own.events].count("rest") == len(rests)  # an event that others count is sent once
    onsets = [onset for (onset,) in rows(tmp_path, "SELECT onset FROM intervals ORDER BY sequence")]
    assert onsets[2] - onsets[1] - 0.01 >= 0.2


def test_a_run_waits_by_its_own_clock_while_the_page_lives_in_real_time(tmp_path):
    plan, clock = study(blocks=(block(rest=3.0),)), SkippingClock()
    with begun(plan, tmp_path, clock=clock) as own, ScriptedParticipant(own.desk) as person:
        assert own.run.run() == FINISHED
    assert person.error is None
    assert clock.skipped == pytest.approx(4 * 3.0, abs=0.5)


def test_a_disk_that_is_full_stops_the_study_and_the_answer_is_kept_once_there_is_room(tmp_path, monkeypatch):
    plan = study(blocks=(block(repetitions=1),))
    with begun(plan, tmp_path) as own, ScriptedParticipant(own.desk):
        add, failures = own.store.add_answer, iter([True, True, False, False])

        def failing(row):
            if next(failures):
                raise StudyStorageError("the answer could not be saved: the disk is full")
            add(row)

        monkeypatch.setattr(own.store, "add_answer", failing)
        reasons = []
        monkeypatch.setattr(own.desk, "stop", lambda reason: (reasons.append(reason), StudyDesk.stop(own.desk, reason)))
        monkeypatch.setattr(own.desk, "await_change", lambda seconds: (own.desk.go_on(), time.sleep(0.001)))
        assert own.run.run() == FINISHED
    assert reasons == ["the answer could not be saved: the disk is full"] * 2
    assert len(rows(tmp_path, "SELECT * FROM answers")) == 2


def test_an_interval_that_was_played_before_a_stop_is_data(tmp_path):
    plan = study(blocks=(block(repetitions=1, gap=0.3),))
    with begun(plan, tmp_path) as own, ScriptedParticipant(own.desk) as person:
        stops = iter([True])

        def send(name, **values):
            if name == "stimulus_ended" and next(stops, False):
                own.desk.stop("in the gap")

        def go_on(screen):
            if screen.kind == "wait":
                own.desk.go_on()
            return first_key(screen)

        own.run._send, person._rule = send, go_on
        assert own.run.run() == FINISHED
    order = rows(tmp_path, "SELECT trial, attempt, interval, outcome FROM intervals ORDER BY sequence")
    assert order[:3] == [(0, 0, 0, "played"), (0, 1, 0, "played"), (0, 1, 1, "played")]


def test_a_key_that_was_pressed_counts_even_where_the_page_is_closed_right_after(tmp_path):
    plan = study(blocks=(block(repetitions=1),))
    with begun(plan, tmp_path) as own, ScriptedParticipant(own.desk) as person:
        stops = iter([True])

        def press_and_stop(screen):
            if screen.kind == "wait":
                own.desk.go_on()
            if screen.kind == "question" and next(stops, False):
                assert own.desk.press(screen.number, screen.keys[0].key, 0.5)
                own.desk.stop("right after the key")
                return None
            return first_key(screen)

        person._rule = press_and_stop
        assert own.run.run() == FINISHED
    assert len([screen for screen in own.shown if screen.kind == "question"]) == 2
    assert rows(tmp_path, "SELECT seconds FROM answers") == [(0.5,), (0.25,)]


def test_an_array_that_fails_ends_the_run_and_what_was_played_is_data(tmp_path):
    plan = study(blocks=(block(repetitions=1),))

    def fail():
        raise DeviceLostError("the array was unplugged")

    with (
        begun(plan, tmp_path, outcomes=["played", fail]) as own,
        ScriptedParticipant(own.desk),
        pytest.raises(DeviceLostError),
    ):
        own.run.run()
    assert own.events[-1] == ("study_ended", {"outcome": "failed"})
    order = rows(tmp_path, "SELECT interval, outcome FROM intervals ORDER BY sequence")
    assert order == [(0, "played"), (1, "stopped before it began: the array was unplugged")]


@pytest.mark.parametrize(
    ("sound", "fault"),
    [
        ("playing", []),
        ("no sound card", ["masking noise: no sound card"]),
        ("", ["masking noise: not played by this page"]),
    ],
)
def test_masking_noise_that_does_not_play_is_a_fault_and_in_the_data(tmp_path, sound, fault):
    plan = study(blocks=(block(repetitions=1),), noise_level=0.1)
    with begun(plan, tmp_path) as own, ScriptedParticipant(own.desk):
        own.desk.set_status(**({"sound": sound} if sound else {}))
        assert own.run.run() == FINISHED
    assert own.desk.status()["faults"] == fault
    kept = rows(tmp_path, "SELECT json_extract(details, '$.state') FROM events WHERE name = 'masking_noise'")
    assert kept == [(sound,)]  # once, as it did not change
    assert {screen.has_noise for screen in own.shown if screen.kind in ("stimulus", "question")} == {True}


def test_answers_of_other_trials_than_this_version_draws_are_refused(tmp_path):
    plan = study(blocks=(block(repetitions=2),))
    with begun(plan, tmp_path) as own:
        place = {
            "block": "cube",
            "block_position": 0,
            "trial": 0,
            "attempt": 0,
            "name": "answer",
            "question": "Which?",
            "kind": "choice",
        }
        row = AnswerRow(design="2ifc", value=0, stimuli=("cube-cc", "cube-cc"), **place)
        own.store.add_answer(row)
    with (
        begun(plan, tmp_path, resume=True) as own,
        ScriptedParticipant(own.desk),
        pytest.raises(StudyError, match="trial 0 of block 'cube' was of cube-cc, cube-cc, but this version"),
    ):
        own.run.run()


def test_a_disk_that_is_full_while_a_question_is_answered_costs_no_answer(tmp_path, monkeypatch):
    plan = study(blocks=(block(repetitions=1),))

    def read_only(screen):
        return None if screen.kind == "question" else first_key(screen)  # `save_poses` answers, as a quick person does

    with begun(plan, tmp_path) as own, ScriptedParticipant(own.desk, read_only) as person:
        failures = iter([True])

        def save_poses():
            screen = own.desk.shown
            if screen.kind == "question" and screen.keys:
                assert own.desk.press(screen.number, screen.keys[0].key, 0.1)
            if next(failures, False):
                raise StudyStorageError("the poses could not be kept: the disk is full")

        monkeypatch.setattr(own.player, "save_poses", save_poses)
        monkeypatch.setattr(own.desk, "await_change", lambda seconds: (own.desk.go_on(), time.sleep(0.001)))
        assert own.run.run() == FINISHED
        assert person.error is None
    assert len(rows(tmp_path, "SELECT * FROM answers")) == 2
    assert [name for (name,) in rows(tmp_path, "SELECT name FROM events WHERE name IN ('stopped', 'gone_on')")] == [
        "stopped",
        "gone_on",
    ]
