"""Whole studies by simulated people, through the page's own protocol on a virtual clock, and as tables alone."""

import os
import re
import sqlite3
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_participants import PERIOD, ObservedTables, emissions_of, observed_table, simulate_study
from study_observers import PAPER_STRENGTHS, Observer, null_observers, paper_observers
from study_plans import CONFIDENCE
from study_plans import block as block_of
from study_plans import study as study_of
from written_plans import EVERY_DESIGN, PAPER, PILOT

from palpate.render.study.plan.expected_run import READY_SECONDS, expected_run
from palpate.render.study.plan.stimulus_judgement import LIVE_TAIL
from palpate.render.study.plan.study_plan import PlannedStimulus
from palpate.render.study.plan.study_reading import read_study
from palpate.render.study.run.study_run import StudyRun

assert StudyRun  # what simulated people answer
SMALL = {"repetitions = 10": "repetitions = 1", "reversals = 6": "reversals = 2", "trials_max = 40": "trials_max = 4"}
SIZES = {f"{size} cm": size / 2 for size in (4, 6, 8, 10)}
PAIR = ("cube-oc", "cube-cc")
HIDDEN = re.compile(r"\b(oc|cc)\b|contour|strateg|latenc|focal|sampling|\br\b", re.IGNORECASE)
ANSWERS = (
    "SELECT code, block, block_position, trial, name, kind, value, label, key, is_practice, track, level, comparison, "
    "clipped, seconds FROM answers ORDER BY sequence"
)


def rows(folder, statement):
    connection = sqlite3.connect(folder / "answers.sqlite")
    try:
        return connection.execute(statement).fetchall()
    finally:
        connection.close()


def plan_of(folder, text):
    path = folder / "study.toml"
    path.write_text(text)
    return read_study(path)


def pairs(*, duration=2.0, **fields):
    """A small plan of pairs."""
    stimuli = tuple(PlannedStimulus(name=own, duration=duration, solid="cube", strategy=own[-2:]) for own in PAIR)
    return study_of(stimuli=stimuli, blocks=(block_of(**({"gap": 1.0, "rest": 1.0} | fields)),))


def observers(count=2, **fields):
    return [Observer(**{"seed": seed, "strengths": PAPER_STRENGTHS | SIZES} | fields) for seed in range(1, count + 1)]


def as_rows(table):
    return [
        (
            own.code, own.block, own.position, own.trial, own.name, own.kind, own.value, own.label, own.key,
            own.is_practice, own.track, own.level, own.comparison, own.clipped, own.seconds,
        )
        for own in table.answers
    ]  # fmt: skip


def share_of_closed(table, code=None, block=None):
    """Share of answers that name the stimulus with closed contours."""
    own = [
        one for one in table.answers
        if one.name == "answer" and code in (None, one.code) and block in (None, one.block) and not one.is_practice
    ]  # fmt: skip
    return float(np.mean([one.stimuli[one.value].endswith("-cc") for one in own]))


def test_the_same_people_give_the_same_answers_through_the_protocol_and_without_it(tmp_path):
    plan = pairs(repetitions=1, practice=1, questions_after=(CONFIDENCE,))
    people = observers()
    simulate_study(plan, people, tmp_path / "one", seed=5)
    simulate_study(plan, people[:1], tmp_path / "again", seed=5)
    stored = rows(tmp_path / "one", ANSWERS)
    assert stored == as_rows(observed_table(plan, people, 5)) != as_rows(observed_table(plan, people, 6))
    assert rows(tmp_path / "again", ANSWERS) == stored[: 3 + 1]
    assert len(stored) == 2 * (3 + 1)
    statement = "SELECT code, block, trial, stimulus, r FROM intervals WHERE r IS NOT NULL AND NOT is_practice"
    ratios = rows(tmp_path / "one", f"{statement} ORDER BY sequence")
    assert ratios == [tuple(own) for own in observed_table(plan, people, 5).ratios]
    assert len(ratios) == 4
    assert all(own[-1] > 1 for own in ratios)


@pytest.mark.exhaustive
def test_every_design_gives_the_same_answers_through_the_protocol_and_without_it(tmp_path):
    text = EVERY_DESIGN
    for long, short in SMALL.items():
        text = text.replace(long, short)
    plan, people = plan_of(tmp_path, text), observers(interval_bias=0.3, lapse=0.1)
    simulate_study(plan, people, tmp_path / "data", seed=3)
    stored = rows(tmp_path / "data", ANSWERS)
    assert stored == as_rows(observed_table(plan, people, 3))
    assert {own[5] for own in stored} == {"choice", "scale", "number", "text"}
    assert {own.name for own in plan.blocks} <= {own.block for own in observed_table(plan, people, 3).answers}


def test_virtual_time_is_what_the_plan_expects_but_for_when_people_press_keys(tmp_path):
    plan = replace(pairs(repetitions=3, instruction="Feel.", questions_after=(CONFIDENCE,)), answer_seconds=1.5)
    people, events, met = observers(1, reaction_median=1.5, reaction_spread=0.0), [], []
    simulate_study(plan, people, tmp_path, events=events, participants=met)
    times = [time for _, name, time, _ in events if name in ("study_begun", "study_ended")]
    (person,) = met
    expected = expected_run(plan, 0, emissions_of(plan)).seconds
    assert person.reaction_seconds == pytest.approx(1.5 * person.answered)
    assert person.answered == 1 + 1 + 6 + 1  # the instruction, the key that begins, trials, confidence
    slack = 6 * READY_SECONDS + 12 * LIVE_TAIL + PERIOD * person.answered + 1.5  # one key begins the first trial
    assert times[1] - times[0] == pytest.approx(expected, abs=slack)
    assert times[1] - times[0] > 6 * (2 * 2.0 + 1.0 + 1.0) + 1.5 * person.answered
    onsets = rows(tmp_path, "SELECT onset, onset_planned, seconds FROM intervals ORDER BY sequence")
    assert all(onset == pytest.approx(planned, abs=1e-6) for onset, planned, _ in onsets)
    assert all(seconds == pytest.approx(2.0, abs=1e-6) for *_, seconds in onsets)


def test_a_page_that_asks_nothing_holds_the_run_and_its_trial_is_played_again(tmp_path):
    plan, people = pairs(repetitions=1), observers(1)
    events = []
    simulate_study(plan, people, tmp_path, silent=(7.0, 20.0), events=events)
    played = rows(tmp_path, "SELECT trial, attempt, interval, outcome FROM intervals ORDER BY sequence")
    stopped = [own for own in played if own[3] != "played"]
    assert len(stopped) == 1
    assert stopped[0][3].startswith("stopped after")
    assert {own[:2] for own in played} == {(0, 0), (0, 1), (1, 0)}
    names = [name for _, name, _, _ in events]
    assert (names.count("stopped"), names.count("gone_on"), names.count("study_ended")) == (1, 1, 1)
    time = {name: time for _, name, time, _ in events}
    assert time["gone_on"] - time["stopped"] > 10.0
    assert rows(tmp_path, "SELECT trial, attempt FROM answers ORDER BY sequence") == [(0, 1), (1, 0)]


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    plan = plan_of(tmp_path_factory.mktemp("paper"), PAPER)
    return plan, ObservedTables(plan)


def test_a_table_of_the_papers_study_has_all_of_its_answers(paper):
    _, tables = paper
    table = tables.table(paper_observers(2))
    assert table.codes == ("P01", "P02")
    assert len(table.answers) == 2 * (1 + 5 + 6 * 12 + 1)
    assert len(table.ratios) == 2 * 60
    assert {own.code for own in table.answers if own.name == "comments" and own.value} == {"P01", "P02"}


def test_what_is_planted_shows_in_the_answers(paper):
    _, tables = paper
    strong = {"opacity_effect": 0.8, "sensitivity": 3.0, "lapse": 0.0}
    shares = {
        sign: share_of_closed(tables.table(observers(2, sign=sign, **strong)), block="cube-1.0") for sign in (1, -1)
    }
    assert shares[1] > 0.9
    assert shares[-1] < 0.1
    habit = tables.table(observers(1, habit="ArrowLeft"))
    assert {own.key for own in habit.answers if own.name == "answer"} == {"ArrowLeft"}
    biased = tables.table(observers(2, sign=0, interval_bias=2.0))
    firsts = [own.value == 0 for own in biased.answers if own.name == "answer"]
    assert np.mean(firsts) > 0.85  # two feelings of noise alone differ by more in 8 % of trials
    ratings = {
        name: np.mean([own.value for own in tables.table(observers(2, sensitivity=size)).answers if own.name == name])
        for size, name in ((4.0, "confidence"), (4.0, "difficulty"))
    }
    assert ratings["confidence"] > ratings["difficulty"] + 1


def test_numbers_follow_a_power_of_the_strength_and_the_larger_one_of_two_is_found(tmp_path):
    plan = plan_of(tmp_path, EVERY_DESIGN)
    table = observed_table(plan, observers(number_noise=0.0, sensitivity=2.0, lapse=0.0))
    numbers = {(own.stimuli, own.value) for own in table.answers if own.block == "magnitude"}
    assert numbers == {
        (("6 cm", name), float(f"{100 * (size / SIZES['6 cm']) ** 0.7:.3g}")) for name, size in SIZES.items()
    }
    right = [own.comparison == own.value for own in table.answers if "8 cm" in own.stimuli and own.block == "constant"]
    assert len(right) == 2 * 20
    assert np.mean(right) > 0.8  # 0.92 are expected: a difference of 2 against noise of 1.41
    levels = [own.level for own in table.answers if own.block == "staircase" and own.trial > 10]
    assert np.mean(levels) > 2.0  # the criterion lies far below all sizes, so that nearly all answers are correct


@pytest.mark.exhaustive
def test_people_who_feel_no_difference_answer_at_random_and_bias_and_opacity_have_their_signs(paper):
    _, tables = paper
    shares = [share_of_closed(tables.table(null_observers(), seed)) for seed in range(20)]
    assert np.mean(shares) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(20 * 18 * 60))
    people = paper_observers()
    found = {
        opacity: np.mean([share_of_closed(tables.table(people, seed), block=f"cube-{opacity}") for seed in range(20)])
        for opacity in (1.0, 0.7)
    }
    assert found[1.0] > found[0.7] + 0.05
    assert np.mean([share_of_closed(tables.table(people, seed)) for seed in range(20)]) > 0.55


@pytest.fixture
def memory(tmp_path):
    """A folder in memory, where there is one: a disk that syncs each of thousands of transactions takes a minute."""
    shared = Path("/dev/shm")
    if not os.access(shared, os.W_OK):
        yield tmp_path
        return
    with tempfile.TemporaryDirectory(dir=shared) as folder:
        yield Path(folder)


@pytest.mark.exhaustive
def test_the_papers_whole_study_by_18_people_is_stored_and_no_page_learns_what_is_rendered(paper, memory):
    plan, tables = paper
    people, met = paper_observers(), []
    simulate_study(plan, people, memory, participants=met)
    stored = rows(memory, ANSWERS)
    assert stored == as_rows(tables.table(people))
    assert len(stored) == 18 * (1 + 5 + 6 * 12 + 1)
    assert rows(memory, "SELECT count(*) FROM participants WHERE finished IS NOT NULL") == [(18,)]
    assert rows(memory, "SELECT count(*), min(outcome), max(outcome) FROM intervals") == [(2160, "played", "played")]
    assert rows(memory, "SELECT count(r), min(r) > 1 FROM intervals") == [(1080, 1)]
    hidden = {own.name for own in plan.stimuli}
    for person in met:
        assert not [word for word in person.words if word in hidden or HIDDEN.search(word)]
        places = {place for place, _ in person.arrays}
        assert places == {".hand.pose", ".hand.patches", ".hand.vertices", ".hand.faces"} | {
            ".object.vertices", ".object.faces",
        }  # fmt: skip
    table = tables.table(people)
    for code, person in zip(plan.codes, people, strict=True):
        if person.sign:  # the cube's effect is strong enough to show in 20 answers of each person
            shares = [share_of_closed(table, code, f"cube-{opacity}") for opacity in (1.0, 0.7)]
            assert (np.mean(shares) - 0.5) * person.sign > -0.2


@pytest.mark.exhaustive
def test_the_pilot_by_six_people_gets_sentences_that_follow_from_what_they_felt(memory):
    plan = plan_of(memory, PILOT)
    strengths = {own.name: 3.0 * own.name.endswith("cc") for own in plan.stimuli}
    people = [Observer(seed=seed, strengths=strengths, sign=int(seed < 5)) for seed in range(6)]  # one feels nothing
    simulate_study(plan, people, memory)
    found = rows(memory, "SELECT code, name, value, stimuli FROM answers WHERE block = 'shapes' ORDER BY sequence")
    assert len(found) == 6 * 5 * 3
    told = [
        (code, (" second " in text) == stimuli.endswith('-cc"]'))
        for code, name, text, stimuli in found
        if name == "objects" and text.startswith("Yes")
    ]
    assert len([code for code, _ in told if code != "P06"]) > 15  # of 25
    assert np.mean([is_right for code, is_right in told if code != "P06"]) > 0.9
    assert rows(memory, "SELECT DISTINCT seconds BETWEEN 19.99 AND 20.01 FROM intervals") == [(1,)]
