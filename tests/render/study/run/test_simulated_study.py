"""Whole studies by simulated people, through the page's own protocol on a virtual clock, and as tables alone."""

import os
import re
import sqlite3
import tempfile
from pathlib import Path

import numpy as np
import pytest
from simulated_participants import ObservedTables, observed_table, simulate_study
from study_observers import PAPER_STRENGTHS, Observer, paper_observers
from study_plans import CONFIDENCE
from study_plans import block as block_of
from study_plans import study as study_of
from written_plans import PAPER

from palpate.render.study.plan.study_plan import PlannedStimulus
from palpate.render.study.plan.study_reading import read_study
from palpate.render.study.run.study_run import StudyRun

assert StudyRun  # what simulated people answer
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
