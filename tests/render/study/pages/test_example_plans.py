"""The paper's study and its pilot, each answered by one simulated person in a real browser, whose time is not skipped.

What the run waits for, intervals and rests, is skipped; the page and its keys live in real time.
"""

import json
import sqlite3
import threading
import time

import pytest
from browser import Browser
from simulated_participants import SimulatedPlayer, emissions_of
from study_cases import moment_at, scene_around, served_study, square_hand
from study_observers import PAPER_RATIOS, PAPER_STRENGTHS, DrawnRatios, Mind, Observer
from virtual_clock import SkippingClock

from palpate.device import array_model
from palpate.render.study.command import _shown_meshes
from palpate.render.study.pages import study_server
from palpate.render.study.plan.block_designs import trial_counts
from palpate.render.study.plan.duty_account import DutyAccount
from palpate.render.study.plan.example_plans import example_text
from palpate.render.study.plan.study_judgement import judge_study
from palpate.render.study.plan.study_reading import read_study
from palpate.render.study.run import desk as desk_module
from palpate.render.study.run.answer_store import AnswerStore
from palpate.render.study.run.desk import StudyDesk
from palpate.render.study.run.study_run import FINISHED, StudyRun

assert study_server  # what the browser is served by
STRENGTHS = PAPER_STRENGTHS | {"sphere-oc": 0.0, "sphere-cc": 1.6, "rock-oc": 0.0, "rock-cc": 0.5}
SCREEN = """JSON.stringify({
    number: document.querySelector('#page').dataset.number ?? '',
    kind: document.querySelector('#page').dataset.kind ?? '',
    text: document.querySelector('.text')?.textContent ?? '',
    keys: [...document.querySelectorAll('.keys li')].map(
        (own) => [own.dataset.key, own.querySelector('span')?.textContent ?? '']),
    points: document.querySelector('.keys.scale') !== null,
    field: document.querySelector('main input, main textarea')?.tagName ?? '',
    isTaken: document.querySelector('.pressed, [readonly]') !== null,
})"""
AGAIN = 0.5  # [s] until a key that the page has not taken, as it was pressed before the screen was painted, comes again
DRAWN = 0.05  # [s] that each interval lasts for the page, so that it draws the object


class SeenPlayer(SimulatedPlayer):
    """Each interval lasts a moment in real time, and its screen is seen however short it is."""

    def play(self, name, **options):
        shown = self._desk.shown
        self._mind.see(1.0 if shown.shown is None else shown.shown.opacity, shown.text)
        time.sleep(DRAWN)
        return super().play(name, **options)


class Person:
    """Reads the page's own document, and presses the keys that an observer chooses."""

    def __init__(self, browser, mind):
        self._browser, self._mind = browser, mind
        self._number, self._pressed, self._keys = "", 0.0, ()

    def look(self):
        """Answer what is new; returns the kind of the screen."""
        screen = json.loads(self._browser.run(SCREEN))
        if screen["number"] != self._number:
            self._number, self._keys = screen["number"], self._answer(screen)
            self._press()
        elif self._keys and not screen["isTaken"] and time.monotonic() - self._pressed > AGAIN:
            self._press()
        return screen["kind"]

    def _press(self):
        *typed, last = self._keys or ("",)
        for text in typed:
            self._browser.call("Input.insertText", text=text)
        if last:
            self._browser.press(last)
        self._pressed = time.monotonic()
        self._keys = self._keys[-1:]  # what is typed stays in its field

    def _answer(self, screen):
        mind, keys, text = self._mind, screen["keys"], screen["text"]
        if screen["kind"] == "text":
            mind.begin_trial()
        if screen["field"]:
            answer = mind.number(text, 18, 120) if screen["field"] == "INPUT" else mind.write(text)
            return (str(answer), "Enter")
        if screen["kind"] != "question" or not keys:
            return tuple(keys[0][:1]) if keys else ()
        if screen["points"]:
            return (keys[mind.rate(text, len(keys)) - 1][0],)
        return (keys[mind.choose(keys)][0],)


def take_part(name, folder, observer):
    """Run one participant of an example plan with a browser; returns plan, outcome and errors of the browser."""
    path = folder / f"{name}.toml"
    path.write_text(example_text(name))
    plan, solids = read_study(path), {}
    assert judge_study(plan, array_model("emulator"), solids=solids).faults == ()
    shown_names, mesh = _shown_meshes(plan, solids)
    moment = moment_at(scene_around(square_hand()))
    desk, clock, mind, outcome = StudyDesk(), SkippingClock(), Mind(observer), []
    with (
        AnswerStore(folder / "data", plan) as store,
        served_study(
            desk, mesh=mesh, scene=lambda: moment.scene, moment=lambda: moment, noise_level=plan.noise_level
        ) as (_, server),
        Browser(folder, width=640, height=400) as browser,
    ):
        run = StudyRun(
            plan, "P01", store=store, progress=store.begin("P01"), desk=desk,
            player=SeenPlayer(plan, desk, clock, mind, DrawnRatios(PAPER_RATIOS, observer, 0)),
            account=DutyAccount(plan.limits), send=lambda name, **values: None, file_hashes={},
            emissions=emissions_of(plan), shown_names=shown_names, clock=clock,
        )  # fmt: skip
        thread = threading.Thread(target=lambda: outcome.append(run.run()), daemon=True)
        browser.open(server.address())
        thread.start()
        person = Person(browser, mind)
        while person.look() != "ended" and thread.is_alive():
            browser.settle(0.01)
        thread.join(10)
        errors = list(browser.errors)
    return plan, outcome, errors


def rows(folder, statement):
    connection = sqlite3.connect(folder / "data" / "answers.sqlite")
    try:
        return connection.execute(statement).fetchall()
    finally:
        connection.close()


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["paper", "pilot"])
def test_an_example_plan_is_answered_to_its_end_in_a_browser(name, tmp_path, monkeypatch):
    monkeypatch.setattr(desk_module, "LOST_SECONDS", 30.0)  # a busy machine may keep the browser waiting
    observer = Observer(seed=4, strengths=STRENGTHS, sensitivity=2.0, lapse=0.0, age=31)
    plan, outcome, errors = take_part(name, tmp_path, observer)
    assert (outcome, errors) == ([FINISHED], [])
    trials = sum(trial_counts(block).least for block in plan.blocks)
    asked = sum(trial_counts(own).least * len(own.questions) + len(own.questions_after) for own in plan.blocks)
    around = len(plan.questions_before) + len(plan.questions_after) + 1  # the consent
    assert rows(tmp_path, "SELECT count(*), max(attempt) FROM answers") == [(asked + around, 0)]
    assert rows(tmp_path, "SELECT count(*), min(outcome), max(outcome) FROM intervals") == [
        (2 * trials, "played", "played")
    ]
    assert rows(tmp_path, "SELECT value FROM answers WHERE name = 'age'") == [(31,)]
    assert all(0 <= seconds < 60 for (seconds,) in rows(tmp_path, "SELECT seconds FROM answers"))
    if name == "paper":
        shares = rows(
            tmp_path, "SELECT avg(chosen = 'cube-cc') FROM tidy_answers WHERE block = 'cube-1.0' AND trial >= 0"
        )
        assert shares[0][0] > 0.7
    else:
        texts = {text for (text,) in rows(tmp_path, "SELECT value FROM answers WHERE block = 'shapes'")}
        assert "Yes, the second one was denser and more filled, the other one like an empty outline." in texts
