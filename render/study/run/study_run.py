"""One participant's way through a study: screens, intervals, answers; what is answered already is not asked again.

All that is random follows from the plan's seed and the participant's number. So a run that goes on replays the answers
on disk, comes to the same trial as before, and plays that one again if it has no answer.
"""

import time
import zlib
from collections import deque
from collections.abc import Callable, Generator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from ....datasets.errors import DatasetError
from ...errors import StudyError, StudyStorageError
from ...live.session import Onset
from ..plan.block_designs import block_numbers, key_order, rng_of, trial_counts, trials_of
from ..plan.duty_account import DutyAccount, EmissionInterval
from ..plan.study_plan import Answer, PlannedBlock, PlannedTrial, Question, StudyPlan
from .answer_store import AnswerStore
from .desk import KeyChoice, Response, ShownObject, StudyClock, StudyDesk
from .interval_player import PLAYED, DrawnInterval, IntervalPlayer, PlayedInterval
from .study_file import ABOUT_CONSENT, AnswerRow, IntervalRow, ParticipantProgress

BEFORE, AFTER = "before", "after"
AFTER_BLOCK = -1
"""Number of the trial in place of those of questions after a block."""
AGREED = 1
EVENTS_SHOWN = 12
_SHOWN: Final = ("block", "trial", "stimulus", "question", "value", "outcome", "reason", "seconds")
LEAD_IN = 0.5  # [s] from the key that begins a trial to its first interval
SPACE = " "
ARROWS = ("ArrowLeft", "ArrowRight")
UNDER_WAY = "under way"  # of an interval before it is over; no row on disk has it
FINISHED, ENDED, DECLINED, FAILED = "finished", "ended", "declined", "failed"
"""What comes of a run."""

T = TypeVar("T")
Send = Callable[..., object]
"""Sends an event to other instruments, as `EventStream.send`."""


class _RunEnded(Exception):
    """The experimenter has ended the run."""


class _TrialHeld(Exception):
    """Nothing may play now: the trial under way is played again later."""


class StudyRun:
    """A participant's run; `run` returns what came of it.

    player: of the stimuli. account: of what the array was driven, from which pauses follow. send: gets events, with the
    array's own time. By the names of stimuli: file_hashes: SHA-256 of stored ones; emissions: what they may emit;
    shown_names: under which the page knows the mesh that is seen. seconds: that the whole run is expected to take [s].
    clock: of intervals and rests.
    """

    def __init__(
        self,
        plan: StudyPlan,
        code: str,
        *,
        store: AnswerStore,
        progress: ParticipantProgress,
        desk: StudyDesk,
        player: IntervalPlayer,
        account: DutyAccount,
        send: Send,
        file_hashes: Mapping[str, str],
        emissions: Mapping[str, EmissionInterval],
        shown_names: Mapping[str, str],
        seconds: float = 0.0,
        clock: StudyClock | None = None,
    ) -> None:
        self._plan, self._code, self._store, self._progress = plan, code, store, progress
        self._desk, self._player, self._account, self._send = desk, player, account, send
        self._file_hashes, self._emissions, self._shown_names = file_hashes, emissions, shown_names
        self._seconds = seconds
        self._clock = clock or StudyClock()
        self._number = plan.codes.index(code)
        self._kept = progress.answers
        self._answers: dict[tuple[str, int, str], Answer] = {key: row.value for key, row in self._kept.items()}
        self._stimuli = {own.name: own for own in plan.stimuli}
        self._trials_done = 0
        self._events: deque[str] = deque(maxlen=EVENTS_SHOWN)
        self._share = 0.0  # of the whole study
        self._position = 0
        self._had_page = False
        self._poses: Path | None = None  # of the interval that plays
        self._has_waited = False  # for the disk
        self._sound: str | None = None  # of the masking noise, as it was kept last
        self._faults: dict[str, str] = {}
        self._is_fresh = True  # nobody has said that they are ready since the last interruption

    def run(self) -> str:
        """Run to the end; returns `FINISHED`, `ENDED` or `DECLINED`.

        Raises what ends the session: the array failed, or a limit was met. What was answered until then is on disk.
        """
        self._desk.set_status(participant=self._code)
        self._report("study_begun", participant=self._code)
        try:
            outcome = self._run()
        except _RunEnded:
            outcome = ENDED
            self._desk.show("ended", self._plan.sentence("ended_early"), progress=self._share)
        except BaseException:  # who records beside the study must know that nothing more comes
            self._report("study_ended", outcome=FAILED)
            raise
        self._report("study_ended", outcome=outcome)
        return outcome

    def _run(self) -> str:
        plan = self._plan
        if not self._answers and plan.welcome:
            self._read(plan.welcome, title=plan.title)
        if plan.consent and not self._agrees():
            self._desk.show("ended", plan.sentence("declined"))
            return DECLINED
        for question in plan.questions_before:
            self._answer_to(BEFORE, AFTER_BLOCK, question)
        for position, number in enumerate(block_numbers(plan, self._number)):
            self._position = position
            self._run_block(number)
        for question in plan.questions_after:
            self._answer_to(AFTER, AFTER_BLOCK, question)
        self._save(self._store.finish)
        self._desk.set_status(trials=f"{self._trials_done} done", minutes_left=0.0)
        self._desk.show("ended", plan.goodbye or plan.sentence("ended"), progress=1.0)
        return FINISHED

    def _agrees(self) -> bool:
        """Ask for consent; of who declines, nothing is kept."""
        plan, (block, trial, name) = self._plan, ABOUT_CONSENT
        question = Question(
            name=name,
            text="\n\n".join(filter(None, (plan.consent, plan.data_statement))),
            kind="choice",
            options=(plan.sentence("decline"), plan.sentence("agree")),
        )
        if self._answers.get(ABOUT_CONSENT) == AGREED:
            return True
        keys = keys_of(plan, question)
        response = self._ask(question, keys)
        if response.value != AGREED:
            self._save(self._store.forget)
            return False
        self._keep_answer(block, trial, question, keys, response)
        return True

    def _run_block(self, number: int) -> None:
        plan, block = self._plan, self._plan.blocks[number]
        trials = trials_of(block, rng_of(plan, self._number, number))
        practice, least, _ = trial_counts(block)
        self._desk.set_status(block=f"{block.name}, {self._position + 1} of {len(plan.blocks)}")
        is_begun = any(key[0] == block.name for key in self._answers)
        if not is_begun:
            self._report("block_begun", block=block.name, design=block.design)
            words = [plan.sentence("practice", count=practice)] if practice else []
            title = plan.sentence("block", number=self._position + 1, count=len(plan.blocks))
            text = "\n\n".join(filter(None, (block.instruction, *words)))
            self._read(text or title, title=title if text else "")
        self._is_fresh = True
        for place, (trial, give) in enumerate(_driven(trials)):
            if place == practice > 0 and (block.name, place, trial.questions[0].name) not in self._answers:
                self._read(plan.sentence("practice_over"))
            count = max(practice + least, place + 1)
            self._share = (self._position + place / count) / len(plan.blocks)
            title = plan.sentence("progress", number=place + 1, count=count)
            if block.design == "staircase":  # whose answers decide how many there are
                title = plan.sentence("progress_open", number=place + 1)
            give(self._run_trial(block, place, trial, title))
            self._trials_done += 1
        for question in block.questions_after:
            self._answer_to(block.name, AFTER_BLOCK, question, block=block)

    def _run_trial(self, block: PlannedBlock, place: int, trial: PlannedTrial, title: str) -> dict[str, Answer]:
        """The answers of a trial, which is played unless one of them is on disk."""
        kept = [own for name in trial.questions if (own := self._kept.get((block.name, place, name.name)))]
        self._require_same(block, place, trial, kept)
        attempt = kept[0].attempt if kept else self._progress.next_attempt(block.name, place)
        played: list[tuple[IntervalRow, PlayedInterval]] = []
        left = self._seconds * (1 - self._share)
        words = [str(place + 1), *["practice"] * trial.is_practice, *[f"attempt {attempt + 1}"] * (attempt > 0)]
        self._desk.set_status(
            trial=", ".join(words),
            trials=f"{self._trials_done} done",
            minutes_left=round(left / 60, 1),
        )
        if not kept:
            while True:
                try:
                    played = self._play_trial(block, place, trial, attempt, title)
                    break
                except _TrialHeld:
                    self._await_permission()
                    attempt += 1
                    self._is_fresh = True
        answers = {}
        for question in trial.questions:
            answers[question.name] = self._answer_to(
                block.name, place, question, block=block, trial=trial, attempt=attempt, title=title,
                shown=lambda: self._keep_intervals(played),
            )  # fmt: skip
        return answers

    def _play_trial(
        self, block: PlannedBlock, place: int, trial: PlannedTrial, attempt: int, title: str
    ) -> list[tuple[IntervalRow, PlayedInterval]]:
        """Play the intervals of a trial; raises _TrialHeld where they were not played to their end."""
        plan, names = self._plan, trial.stimuli
        self._rest(block, names)
        if self._is_fresh:
            self._read(plan.sentence("ready"), title=title, label="begin")
            self._is_fresh = False
        self._store_event("trial_begun", block=block.name, trial=place, attempt=attempt, stimuli=list(trial.stimuli))
        planned = self._clock.now() + LEAD_IN
        played: list[tuple[IntervalRow, PlayedInterval]] = []
        for interval, name in enumerate(names):
            screen = self._interval_screen(block, trial, interval, name, title)
            file = self._stimuli[name].file
            row = IntervalRow(
                block=block.name, block_position=self._position, trial=place, attempt=attempt, interval=interval,
                stimulus=name, is_practice=trial.is_practice, file=None if file is None else file.name,
                file_sha256=self._file_hashes.get(name), onset_planned=planned, outcome=UNDER_WAY,
            )  # fmt: skip
            try:
                own = self._play_interval(row, screen)
                played.append((row, own))
                if own.outcome != PLAYED:
                    if not self._desk.is_held:  # the disk, not a person, has stopped it
                        self._desk.stop(own.outcome)
                    raise _TrialHeld
            except BaseException as error:  # also where the array fails, or Ctrl-C: what was played before is data
                if not isinstance(error, _TrialHeld):
                    own = self._player.broken(name, error, self._poses)
                    self._report("stimulus_ended", is_estimate=True, stimulus=name, outcome=own.outcome)
                    played.append((row, own))
                self._keep_intervals(played)
                raise
            assert own.onset is not None  # it was played
            planned = max(own.onset + self._stimuli[name].duration + block.gap, own.ended or 0.0)
            if interval + 1 < len(names):
                self._desk.show("stimulus", **(screen | {"text": plan.sentence("gap")}))
        return played

    def _play_interval(self, row: IntervalRow, screen: dict[str, Any]) -> PlayedInterval:
        keeps = self._stimuli[row.stimulus].file is None and self._plan.records_poses
        # The path first: it makes and syncs a folder, which would delay the onset.
        path = None
        if keeps:
            place = row.block_position, row.trial, row.interval, row.attempt
            self._has_waited = False
            path = self._save(lambda: self._store.poses_path(*place))
            if self._has_waited:  # the trial was interrupted
                raise _TrialHeld
        self._poses = path
        self._wait_until(row.onset_planned or 0.0)
        self._desk.show("stimulus", **screen)
        self._desk.set_status(stimulus=row.stimulus)
        is_asking = False

        def ask_for_hand() -> None:
            nonlocal is_asking
            if not is_asking:
                is_asking = True
                self._desk.show("stimulus", **(screen | {"text": self._plan.sentence("no_hand")}))

        def begun(onset: Onset) -> None:
            if is_asking:
                self._desk.show("stimulus", **screen)
            self._report(
                "stimulus_onset", array_time=onset.time, is_estimate=onset.is_estimate, block=row.block,
                trial=row.trial, interval=row.interval, stimulus=row.stimulus,
            )  # fmt: skip

        own = self._player.play(
            row.stimulus,
            poses_file=path,
            is_held=lambda: self._desk.is_held,
            begun=begun,
            waits_for_hand=ask_for_hand,
        )
        self._note_sound()
        self._report(
            "stimulus_ended", array_time=own.ended, is_estimate=True, stimulus=row.stimulus, outcome=own.outcome
        )
        if own.onset is not None and own.ended is not None:
            seconds = own.ended - own.onset
            duty = self._emissions[row.stimulus].duty * own.seconds_on / seconds
            self._account.note(own.onset, seconds, duty)
        return own

    def _keep_intervals(self, played: list[tuple[IntervalRow, PlayedInterval]]) -> None:
        """Put intervals on disk: while the participant thinks, as their files take a moment to be read."""
        self._save(self._player.save_poses)
        while played:
            row, own = played[0]
            if own.poses_file is not None and not own.poses_file.exists():  # nothing was drawn
                own = replace(own, poses_file=None)
            whole = _whole_row(row, own, self._drawn(own))
            if own.onset is not None:
                whole = replace(whole, driven=self._emissions[row.stimulus].duty * own.seconds_on)
            self._save(lambda whole=whole: self._store.add_interval(whole))
            played.pop(0)

    def _drawn(self, own: PlayedInterval) -> DrawnInterval | None:
        try:
            return self._player.drawn(own)
        except DatasetError as error:
            name, text = "" if own.poses_file is None else own.poses_file.name, str(error)
            self._save(lambda: self._store.add_event("poses_unreadable", file=name, text=text))
            return None

    def _answer_to(
        self,
        block_name: str,
        place: int,
        question: Question,
        *,
        block: PlannedBlock | None = None,
        trial: PlannedTrial | None = None,
        attempt: int = 0,
        title: str = "",
        shown: Callable[[], object] = lambda: None,
    ) -> Answer:
        """The answer on disk, or the participant's, which is on disk when this returns.

        shown: called once the question is shown.
        """
        key = (block_name, place, question.name)
        if key not in self._answers:
            keys = keys_of(self._plan, question, self._key_order(block_name, place, question, trial))
            response = self._ask(question, keys, title=title, shown=shown)
            self._keep_answer(block_name, place, question, keys, response, block=block, trial=trial, attempt=attempt)
        return self._answers[key]

    def _ask(
        self,
        question: Question,
        keys: tuple[KeyChoice, ...],
        *,
        title: str = "",
        shown: Callable[[], object] = lambda: None,
    ) -> Response:
        hint = self._plan.sentence(question.kind) if question.kind in ("number", "text") else ""
        refusal = ""
        if question.kind == "number" and question.low is not None and question.high is not None:
            refusal = self._plan.sentence("out_of_range", low=question.low, high=question.high)

        def show() -> None:
            self._desk.show(
                "question",
                question.text,
                title=title,
                hint=hint,
                keys=keys,
                question=question,
                refusal=refusal,
                **self._common(),
            )
            shown()

        return self._response_to(show)

    def _keep_answer(
        self,
        block_name: str,
        place: int,
        question: Question,
        keys: tuple[KeyChoice, ...],
        response: Response,
        *,
        block: PlannedBlock | None = None,
        trial: PlannedTrial | None = None,
        attempt: int = 0,
    ) -> None:
        """Put an answer on disk, then report it to other instruments."""
        is_choice = question.kind == "choice"
        row = AnswerRow(
            block=block_name, block_position=-1 if block is None else self._position,
            design="" if block is None else block.design, trial=place, attempt=attempt, name=question.name,
            question=question.text, kind=question.kind, value=response.value,
            label=question.options[int(response.value or 0)] if is_choice else "", key=response.key,
            key_order=tuple(int(own.value or 0) for own in keys) if is_choice else (),
            stimuli=() if trial is None else trial.stimuli, is_practice=trial is not None and trial.is_practice,
            track=0 if trial is None else trial.track, level=None if trial is None else trial.level,
            comparison=None if trial is None else trial.comparison, clipped=0 if trial is None else trial.clipped,
            seconds=response.seconds,
        )  # fmt: skip
        self._save(lambda: self._store.add_answer(row))
        self._answers[block_name, place, question.name] = response.value
        self._report(
            "answer", block=block_name, trial=place, question=question.name, value=response.value, key=response.key
        )

    def _read(self, text: str, *, title: str = "", label: str = "continue") -> None:
        """Show a text until the space bar is pressed. label: name of the sentence beside it."""
        keys = (KeyChoice(key=SPACE, label=self._plan.sentence(label)),)
        self._response_to(lambda: self._desk.show("text", text, title=title, keys=keys, **self._common()))

    def _response_to(self, show: Callable[[], object]) -> Response:
        """What the participant answers to a screen, which is shown again after an interruption."""
        while True:
            self._await_permission()
            show()
            while True:  # a response counts even where the page was closed right after it
                if (response := self._desk.await_response(0.25)) is not None:
                    return response
                if self._desk.is_held:
                    break

    def _await_permission(self) -> None:
        """Wait until something may be shown and played; raises _RunEnded where the run is ended."""
        desk = self._desk
        if desk.is_ended:
            raise _RunEnded
        if not desk.is_held:
            self._had_page = True
            return
        if self._had_page:  # else the participant has not come yet
            self._store_event("stopped", reason=desk.status()["stop_reason"] or "the participant's page was closed")
            desk.show("wait", self._plan.sentence("stopped"), progress=self._share)
        self._is_fresh = True
        while desk.is_held:
            if desk.is_ended:
                raise _RunEnded
            desk.await_change(0.1)
        if self._had_page:
            self._store_event("gone_on")
        self._had_page = True

    def _wait_until(self, when: float) -> None:
        """Wait for a time [s of time.monotonic()]; raises _TrialHeld where the run is held meanwhile."""
        while (left := when - self._clock.now()) > 0:
            if self._desk.is_held:
                raise _TrialHeld
            self._desk.await_change(left, self._clock) if left > 0.02 else self._clock.sleep(left)

    def _rest(self, block: PlannedBlock, names: tuple[str, ...]) -> None:
        """Wait as long as the block asks for, and as the array's limits demand before these intervals."""
        emissions = [
            replace(self._emissions[name], gap=0.0 if place == 0 else block.gap) for place, name in enumerate(names)
        ]
        pause = max(self._account.pause_before(self._clock.now() + LEAD_IN, emissions), block.rest - LEAD_IN)
        ends = self._clock.now() + pause
        if pause > block.rest:
            self._store_event("rest", seconds=pause)
            self._desk.show("rest", self._plan.sentence("rest"), ends=ends, **self._common())
        else:
            self._desk.show("text", "", **self._common())
        self._wait_until(ends)

    def _note_sound(self) -> None:
        """Keep the state of the masking noise where it has changed: a browser may not be allowed to play it."""
        sound = self._desk.status().get("sound", "")
        if self._plan.noise_level > 0 and sound != self._sound:
            self._sound = sound
            self._set_fault(
                "noise", "" if sound == "playing" else f"masking noise: {sound or 'not played by this page'}"
            )
            self._store_event("masking_noise", state=sound)

    def _set_fault(self, name: str, text: str) -> None:
        """Show the experimenter a fault, or with no text that it is over."""
        self._faults = {
            **{key: own for key, own in self._faults.items() if key != name},
            **({name: text} if text else {}),
        }
        self._desk.set_status(faults=list(self._faults.values()))

    def _save(self, action: Callable[[], T]) -> T:
        """Put something on disk; while that fails, nothing goes on and nothing is lost: the experimenter reads why."""
        reason = ""
        while True:
            try:
                result = action()
                break
            except StudyStorageError as error:
                reason = str(error)
                self._set_fault("disk", reason)
                self._desk.stop(reason)
                if self._desk.shown.kind != "question":  # which keeps its keys, and an answer that was given already
                    self._desk.show("wait", self._plan.sentence("stopped"), progress=self._share)
                self._report("stopped", reason=reason)
            while self._desk.is_stopped and not self._desk.is_ended:
                self._desk.await_change(0.1)
            if self._desk.is_ended:
                return action()  # a last time; what it raises ends the run
        if reason:
            self._has_waited = self._is_fresh = True
            self._set_fault("disk", "")
            self._save(lambda: self._store.add_event("stopped", reason=reason))
            self._store_event("gone_on")
        return result

    def _key_order(
        self, block_name: str, place: int, question: Question, trial: PlannedTrial | None
    ) -> tuple[int, ...]:
        """Number of the option that each key gives; empty: as they are listed."""
        if trial is not None:
            return trial.key_orders[trial.questions.index(question)]
        # A stream of its own: blocks have those of their numbers, and their random order that of the next one.
        words = zlib.crc32(f"{block_name}/{place}/{question.name}".encode())
        seed = [self._plan.seed, self._number, len(self._plan.blocks) + 1, words]
        return key_order(question, np.random.default_rng(seed))

    def _require_same(self, block: PlannedBlock, place: int, trial: PlannedTrial, kept: list[AnswerRow]) -> None:
        """Raise StudyError where answers on disk are of other stimuli than this version of palpate would play."""
        for own in kept:
            if own.stimuli != trial.stimuli:
                raise StudyError(
                    f"trial {place} of block {block.name!r} was of {', '.join(own.stimuli)}, but this version of "
                    f"palpate or NumPy draws {', '.join(trial.stimuli)}: go on with the versions that `sessions` names"
                )

    def _store_event(self, name: str, **values: Any) -> None:
        self._save(lambda: self._store.add_event(name, **values))
        self._report(name, **values)

    def _report(self, name: str, **values: Any) -> None:
        """Report an event to other instruments and to the experimenter."""
        self._send(name, **values)
        shown = {key: value for key, value in values.items() if key in _SHOWN and value not in ("", AFTER_BLOCK)}
        words = (f"{key} {value + 1 if key == 'trial' else value}" for key, value in shown.items())
        self._events.append(" ".join((time.strftime("%H:%M:%S"), name.replace("_", " "), *words)))
        duty = self._account.mean_duty(self._clock.now())
        self._desk.set_status(events=list(self._events), duty=round(duty, 3))

    def _common(self) -> dict[str, Any]:
        return {
            "has_noise": self._plan.noise_level > 0,
            "progress": self._share,
        }

    def _interval_screen(
        self, block: PlannedBlock, trial: PlannedTrial, interval: int, name: str, title: str
    ) -> dict[str, Any]:
        """Fields of the screen of an interval."""
        plan, stimulus, count = self._plan, self._stimuli[name], len(trial.stimuli)
        text = plan.sentence("interval", number=interval + 1) if count > 1 else ""
        if block.modulus is not None and interval == 0:
            text = plan.sentence("modulus", value=block.modulus[1])
        seen, shown = self._shown_names.get(stimulus.name), None
        if seen is not None and (block.opacity > 0 or block.shows_hand):
            shown = ShownObject(solid=seen, opacity=block.opacity, has_hand=block.shows_hand)
        return {"text": text, "title": title, "shown": shown, **self._common()}


def keys_of(plan: StudyPlan, question: Question, order: tuple[int, ...] = ()) -> tuple[KeyChoice, ...]:
    """Keys of a question, each with the answer that it gives; order: the option's number under each key."""
    if question.kind == "scale":
        return tuple(
            KeyChoice(key=str(point % 10), label=str(point), value=point)
            for point in range(1, question.point_count + 1)
        )
    if question.kind != "choice":
        return ()
    count = len(question.options)
    keys = plan.choice_keys or (ARROWS if count == 2 else tuple(str(number % 10) for number in range(1, count + 1)))
    order = order or tuple(range(count))
    return tuple(
        KeyChoice(key=key, label=question.options[option], value=option)
        for key, option in zip(keys[: len(order)], order, strict=True)
    )


def _driven(
    trials: Generator[PlannedTrial, Mapping[str, Answer], None],
) -> Generator[tuple[PlannedTrial, Callable[[dict[str, Answer]], object]], None, None]:
    """Trials, each with the function that takes its answers before the next one is made."""
    given: list[dict[str, Answer]] = []
    trial = next(trials, None)
    while trial is not None:
        yield trial, given.append
        try:
            trial = trials.send(given.pop())
        except StopIteration:
            return


def _whole_row(row: IntervalRow, own: PlayedInterval, drawn: DrawnInterval | None) -> IntervalRow:
    """A row with what was played."""
    return replace(
        row,
        onset=own.onset,
        is_estimate=own.is_estimate,
        latency=own.latency,
        ended=own.ended,
        seconds=None if own.onset is None or own.ended is None else own.ended - own.onset,
        outcome=own.outcome,
        poses_file=None if own.poses_file is None else own.poses_file.name,
        **({} if drawn is None else asdict(drawn)),
    )
