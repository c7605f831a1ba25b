"""Whole studies by simulated people: through the real pages' protocol on a virtual clock, or as a table alone.

A simulated participant knows only what their page gets, and what their skin feels. What is played the page must not
say, so the player, which plays nothing, tells it to the skin.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from page_oracle import decoded
from study_cases import moment_at, scene_around, square_hand
from study_observers import PAPER_RATIOS, DrawnRatios, Mind, Observer
from virtual_clock import VirtualClock

from palpate.render.live.session import Onset
from palpate.render.study.analysis.answer_reading import AnswerRecord, RatioRecord, StudyTable
from palpate.render.study.pages.participant_page import ParticipantPage
from palpate.render.study.plan.block_designs import block_numbers, rng_of, trials_of
from palpate.render.study.plan.duty_account import DutyAccount, EmissionInterval
from palpate.render.study.plan.stimulus_judgement import LIVE_TAIL
from palpate.render.study.plan.study_plan import PlannedBlock, PlannedTrial, Question, StudyPlan
from palpate.render.study.run.answer_store import AnswerStore
from palpate.render.study.run.desk import StudyClock, StudyDesk
from palpate.render.study.run.interval_player import PLAYED, DrawnInterval, PlayedInterval
from palpate.render.study.run.study_file import ABOUT_CONSENT, SessionSetup
from palpate.render.study.run.study_run import AFTER, AFTER_BLOCK, AGREED, BEFORE, FINISHED, StudyRun, keys_of
from palpate.render.view.packing import Packer
from palpate.render.view.served.page_server import PageRequest

PERIOD = 0.25  # [s] between two questions of a simulated page for its screen; a browser asks about 30 times a second
STEP = 0.1  # [s] between two looks of the player whether the run is held
BREAK = 1000.0  # [s] between two participants
Ratios = Mapping[tuple[str, float], tuple[float, float]]
"""Mean of r and standard deviation of log(r - 1), by object and opacity."""


def triangle(shown: object = None) -> tuple[np.ndarray, np.ndarray]:
    """A mesh that a page may draw."""
    return np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32)


class SimulatedPlayer:
    """Plays nothing for as long as a stimulus lasts, and tells the skin which one it is."""

    update_rate = 10e3

    def __init__(self, plan: StudyPlan, desk: StudyDesk, clock: StudyClock, mind: Mind, ratios: DrawnRatios) -> None:
        self._stimuli = {own.name: own for own in plan.stimuli}
        self._desk, self._clock, self._mind, self._ratios = desk, clock, mind, ratios
        self._drawn: dict[float, DrawnInterval] = {}

    def play(self, name, *, poses_file, is_held, begun, waits_for_hand) -> PlayedInterval:
        """As IntervalPlayer's."""
        if is_held():
            return PlayedInterval(stimulus=name, outcome="stopped before it began")
        clock, planned = self._clock, self._stimuli[name]
        onset, shown = clock.now(), self._desk.shown.shown
        begun(Onset(time=onset, latency=0.005, is_estimate=False))
        self._mind.feel(name)
        if planned.file is None:
            opacity = 0.0 if shown is None else shown.opacity
            r = self._ratios.of(planned.solid or "", opacity) if planned.strategy == "cc" else None
            self._drawn[onset] = DrawnInterval(
                poses=1, pose_latency_p50=0.006, pose_latency_p99=0.009, dropped=0, length_mean=0.2, r=r, r_open=r
            )
        while (left := onset + planned.duration - clock.now()) > 1e-6:
            clock.sleep(min(left, STEP))
            if is_held():
                break
        ended = clock.now()
        seconds = ended - onset
        return PlayedInterval(
            stimulus=name, outcome=PLAYED if left <= STEP else f"stopped after {seconds:.3f} s", onset=onset,
            latency=0.005, ended=ended, seconds_on=seconds,
        )  # fmt: skip

    def broken(self, name: str, error: BaseException, poses_file: Path | None) -> PlayedInterval:
        """As IntervalPlayer's."""
        return PlayedInterval(stimulus=name, outcome=f"stopped before it began: {error}")

    def save_poses(self) -> None:
        """There are none."""

    def drawn(self, interval: PlayedInterval) -> DrawnInterval | None:
        """With r from the table; once for each interval."""
        return None if interval.onset is None else self._drawn.pop(interval.onset, None)


class SimulatedParticipant:
    """Reads their page as a browser gets it, and presses keys when their reaction time has gone by; for a `with`.

    silent: for which their page asks nothing, as if the browser hung: from, to [s of the clock].
    """

    def __init__(
        self,
        page: ParticipantPage,
        mind: Mind,
        clock: VirtualClock,
        *,
        period: float = PERIOD,
        silent: tuple[float, float] | None = None,
    ) -> None:
        self._page, self._mind, self._clock, self._period, self._silent = page, mind, clock, period, silent
        self._visit = page.visit()
        self._number, self._object = -1, 0
        self._is_over = False
        self.words: set[str] = set()
        """Every text that the page got, names of fields included."""
        self.arrays: set[tuple[str, tuple[int, ...]]] = set()
        """Place in the answer, and shape, of every array that it got."""
        self.reaction_seconds = 0.0
        """Sum over all screens."""
        self.answered = 0
        """Screens."""

    def __enter__(self) -> "SimulatedParticipant":
        self._look()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._visit.close()

    def ask(self, **request: Any) -> dict[str, Any]:
        """The answer to a request, with its arrays; both go through bytes, as between browser and server."""
        messages: list[bytes] = []

        def send(described: dict[str, Any], packer: Packer | None) -> None:
            text = json.dumps(described, allow_nan=False).encode()
            messages.append(len(text).to_bytes(4, "little") + text + (b"" if packer is None else packer.content()))

        self._visit.answer(PageRequest(json.loads(json.dumps(request))), send)
        (message,) = messages
        size = int.from_bytes(message[:4], "little")
        return decoded(json.loads(message[4 : 4 + size]), message[4 + size :])

    def _look(self) -> None:
        if self._is_over:
            return
        now = self._clock.now()
        if self._silent is None or not self._silent[0] <= now < self._silent[1]:
            answer = self.ask(ask="screen", after=self._number, sound="playing")
            if answer["number"] != self._number:
                self._number = answer["number"]
                self._note(answer)
                self._read(answer["screen"])
        self._clock.call_at(now + self._period, self._look)

    def _read(self, screen: dict[str, Any]) -> None:
        mind, kind, question = self._mind, screen["kind"], screen["question"]
        shown = screen["shown"]
        if shown is not None and shown["number"] != self._object:
            self._object = shown["number"]
            self._note(self.ask(ask="object"))
        if kind == "stimulus":
            mind.see(1.0 if shown is None else shown["opacity"], screen["text"])
        elif kind != "question":
            mind.begin_trial()
        keys = [(own["key"], own["label"]) for own in screen["keys"]]
        if question is None:
            if keys:
                self._plan_answer(mind.reading_seconds(), ask="press", key=keys[0][0])
            return
        answer = _answer_of(mind, question["kind"], question["text"], keys, question)
        name = "key" if keys else "value"
        self._plan_answer(mind.seconds(), ask="press" if keys else "give", **{name: answer})

    def _plan_answer(self, seconds: float, **request: Any) -> None:
        number = self._number
        self.reaction_seconds += seconds
        self.answered += 1

        def answer() -> None:
            if not self._is_over and number == self._number:
                self.ask(screen=number, seconds=seconds, **request)

        self._clock.call_at(self._clock.now() + seconds, answer)

    def _note(self, answer: Any, path: str = "") -> None:
        """Keep what the page got, to be searched."""
        if isinstance(answer, dict):
            for name, value in answer.items():
                self.words.add(name)
                self._note(value, f"{path}.{name}")
        elif isinstance(answer, list):
            for value in answer:
                self._note(value, path)
        elif isinstance(answer, str):
            self.words.add(answer)
        elif isinstance(answer, np.ndarray):
            self.arrays.add((path, answer.shape))


def _answer_of(
    mind: Mind, kind: str, text: str, keys: Sequence[tuple[str, str]], bounds: Mapping[str, Any]
) -> str | float:
    """The key that is pressed, or what is typed."""
    if kind == "choice":
        return keys[mind.choose(keys)][0]
    if kind == "scale":
        return keys[mind.rate(text, len(keys)) - 1][0]
    return mind.number(text, bounds["low"], bounds["high"]) if kind == "number" else mind.write(text)


def simulate_study(
    plan: StudyPlan,
    observers: Sequence[Observer],
    folder: Path,
    *,
    seed: int = 0,
    ratios: Ratios = PAPER_RATIOS,
    period: float = PERIOD,
    silent: tuple[float, float] | None = None,
    participants: list[SimulatedParticipant] | None = None,
    events: list[tuple[str, str, float, dict[str, Any]]] | None = None,
) -> Path:
    """Run all observers through a plan, each as its own process would; returns the folder of the data.

    silent: seconds of each run in which the page is silent, from and to. participants, events: get the participants,
    and code, name, time [s] and values of each event.
    """
    clock, moment = VirtualClock(), moment_at(scene_around(square_hand()))
    for code, observer in zip(plan.codes, observers, strict=False):
        clock = VirtualClock(clock.now() + BREAK)
        with AnswerStore(folder, plan) as store:
            store.keep_stimuli({own.name: (None, own.value) for own in plan.stimuli})
            progress = store.begin(code, setup=SessionSetup(array="simulated", source="simulated", hand=plan.hand))
            desk, mind = StudyDesk(clock), Mind(observer, seed)

            def send(name: str, *, code=code, clock=clock, **values: Any) -> None:
                if events is not None:
                    events.append((code, name, clock.now(), values))

            run = StudyRun(
                plan, code, store=store, progress=progress, desk=desk,
                player=SimulatedPlayer(plan, desk, clock, mind, DrawnRatios(ratios, observer, seed)),
                account=DutyAccount(plan.limits), send=send, file_hashes={}, emissions=emissions_of(plan),
                shown_names=shown_names_of(plan), clock=clock,
            )  # fmt: skip
            page = ParticipantPage(desk, lambda: moment.scene, lambda: moment, triangle, noise_level=plan.noise_level)
            own = None if silent is None else (clock.now() + silent[0], clock.now() + silent[1])
            with SimulatedParticipant(page, mind, clock, period=period, silent=own) as participant:
                outcome = run.run()
            assert outcome == FINISHED
            if participants is not None:
                participants.append(participant)
    return folder


def emissions_of(plan: StudyPlan) -> dict[str, EmissionInterval]:
    """What each stimulus may emit, as `judge_study` counts live ones: at full drive."""
    return {
        own.name: EmissionInterval(
            stimulus=own.name, seconds=own.duration + (LIVE_TAIL if own.file is None else 0.0), duty=1.0
        )
        for own in plan.stimuli
    }


def shown_names_of(plan: StudyPlan) -> dict[str, str]:
    """Numbers of what is seen, one for each object, which do not tell how it is rendered."""
    seen = dict.fromkeys(own.shown or own.solid or "" for own in plan.stimuli)
    numbers = {name: str(number) for number, name in enumerate(seen)}
    return {own.name: numbers[own.shown or own.solid or ""] for own in plan.stimuli}


class ObservedTables:
    """Tables of a plan by observers without protocol, clock or files: the same answers, in milliseconds.

    Trials other than a staircase's are made once, as they follow from the plan's seed. After a block, the keys of a
    choice stand as they are listed.
    """

    def __init__(self, plan: StudyPlan) -> None:
        self.plan = plan
        self._strategies = {own.name: own for own in plan.stimuli}
        self._orders = [block_numbers(plan, number) for number in range(len(plan.codes))]
        self._trials = {
            (participant, number): [
                (trial, self._asked(trial.questions, trial.key_orders), self._texts(block, trial))
                for trial in trials_of(block, rng_of(plan, participant, number))
            ]
            for participant in range(len(plan.codes))
            for number, block in enumerate(plan.blocks)
            if block.design != "staircase"
        }
        self._around = {
            id(questions): self._asked(questions, ())
            for questions in (
                plan.questions_before, plan.questions_after, *(block.questions_after for block in plan.blocks)
            )
        }  # fmt: skip

    def __repr__(self) -> str:
        return f"ObservedTables({self.plan.title!r})"

    def table(self, observers: Sequence[Observer], seed: int = 0, ratios: Ratios = PAPER_RATIOS) -> StudyTable:
        """The answers of observers, in the order of the plan's codes."""
        plan, answers, found = self.plan, [], []
        codes = plan.codes[: len(observers)]
        for participant, (code, observer) in enumerate(zip(codes, observers, strict=True)):
            mind, drawn = Mind(observer, seed), DrawnRatios(ratios, observer, seed)
            if plan.consent:
                question = Question(
                    name=ABOUT_CONSENT[2], text="", kind="choice",
                    options=(plan.sentence("decline"), plan.sentence("agree")),
                )  # fmt: skip
                given = _given(mind, code, BEFORE, -1, AFTER_BLOCK, self._asked((question,), ()))
                assert given[0].value == AGREED
                answers += given
            answers += _given(mind, code, BEFORE, -1, AFTER_BLOCK, self._around[id(plan.questions_before)])
            for position, number in enumerate(self._orders[participant]):
                block = plan.blocks[number]
                for place, (trial, asked, texts) in enumerate(self._block_trials(participant, number, answers)):
                    self._feel(mind, block, trial, texts)
                    found += self._ratios_of(drawn, code, block, place, trial)
                    answers += _given(mind, code, block.name, position, place, asked, trial)
                after = self._around[id(block.questions_after)]
                answers += _given(mind, code, block.name, position, AFTER_BLOCK, after)
            answers += _given(mind, code, AFTER, -1, AFTER_BLOCK, self._around[id(plan.questions_after)])
        return StudyTable(
            plan=plan, codes=codes, answers=tuple(answers), ratios=tuple(found)
        )  # fmt: skip

    def _block_trials(self, participant: int, number: int, answers: list[AnswerRecord]) -> Iterable[tuple]:
        """Trials of a block; of a staircase each one follows from the answer before, the last of `answers`."""
        if (participant, number) in self._trials:
            yield from self._trials[participant, number]
            return
        plan, block = self.plan, self.plan.blocks[number]
        trials = trials_of(block, rng_of(plan, participant, number))
        trial = next(trials, None)
        while trial is not None:
            yield trial, self._asked(trial.questions, trial.key_orders), self._texts(block, trial)
            try:
                trial = trials.send({block.question.name: answers[-1].value})
            except StopIteration:
                return

    def _asked(self, questions: Sequence[Question], orders: Sequence[tuple[int, ...]]) -> list[tuple]:
        """Each question with its keys, their labels, and the value of each."""
        asked = []
        for place, question in enumerate(questions):
            keys = keys_of(self.plan, question, orders[place] if orders else ())
            bounds = {"low": question.low, "high": question.high}
            asked.append(
                (question, [(own.key, own.label) for own in keys], {own.key: own.value for own in keys}, bounds)
            )
        return asked

    def _texts(self, block: PlannedBlock, trial: PlannedTrial) -> list[str]:
        """What is read during each interval, as far as observers take notice of it."""
        first = "" if block.modulus is None else self.plan.sentence("modulus", value=block.modulus[1])
        return [first if place == 0 else "" for place in range(len(trial.stimuli))]

    def _feel(self, mind: Mind, block: PlannedBlock, trial: PlannedTrial, texts: list[str]) -> None:
        opacity = block.opacity if block.opacity > 0 or block.shows_hand else 1.0
        mind.begin_trial()
        for name, text in zip(trial.stimuli, texts, strict=True):
            mind.see(opacity, text)
            mind.feel(name)

    def _ratios_of(
        self, drawn: DrawnRatios, code: str, block: PlannedBlock, place: int, trial: PlannedTrial
    ) -> Iterable[RatioRecord]:
        for name in trial.stimuli:
            own = self._strategies[name]
            if own.file is None and own.strategy == "cc":
                r = drawn.of(own.solid or "", block.opacity)
                if not trial.is_practice:
                    yield RatioRecord(code, block.name, place, name, r)


def observed_table(
    plan: StudyPlan, observers: Sequence[Observer], seed: int = 0, ratios: Ratios = PAPER_RATIOS
) -> StudyTable:
    """One table of a plan; of many, make ObservedTables once, which takes longer than a table."""
    return ObservedTables(plan).table(observers, seed, ratios)


def _given(
    mind: Mind,
    code: str,
    block: str,
    position: int,
    place: int,
    asked: list[tuple],
    trial: PlannedTrial | None = None,
) -> list[AnswerRecord]:
    """The answers to questions, as they are stored."""
    given = []
    for question, keys, values, bounds in asked:
        key = _answer_of(mind, question.kind, question.text, keys, bounds)
        seconds = mind.seconds()
        value = values[key] if keys else key
        label = question.options[value] if question.kind == "choice" else ""
        pressed = key if keys else "Enter"
        about = (code, block, position, place, question.name, question.kind, value, label, pressed)
        if trial is None:
            given.append(AnswerRecord(*about, seconds=seconds))
        else:
            own = trial
            more = (own.stimuli, own.is_practice, own.track, own.level, own.comparison, own.clipped, seconds)
            given.append(AnswerRecord(*about, *more))
    return given
