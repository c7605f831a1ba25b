"""A participant's run as it is expected to go: when each interval begins, and how the array rests in between."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from ...errors import StudyError
from .block_designs import block_numbers, rng_of, trial_counts, trials_of
from .duty_account import DutyAccount, EmissionInterval
from .study_plan import StudyPlan

READY_SECONDS = 1.0  # between the end of a rest and the key that begins a trial


class ExpectedTrial(NamedTuple):
    """A trial of a run, if each answer takes the plan's `answer_seconds`."""

    block: str
    number: int
    """Within its block, practice included."""
    is_practice: bool
    stimuli: tuple[str, ...] | None
    """None in a staircase, where they depend on the answers."""
    onsets: tuple[float, ...]
    """Of its intervals, from the beginning of the run on [s]."""
    rest: float
    """Silence before it [s], as long as the block or the array's limits ask for."""


@dataclass
class ExpectedRun:
    """What a whole run amounts to."""

    participant: str
    """Code."""
    blocks: tuple[str, ...]
    """Names, in the order of this participant."""
    trials: list[ExpectedTrial] = field(default_factory=list)
    block_seconds: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    on_time_worst: float = 0.0
    """Longest emission without a pause [s]."""
    duty_worst: float = 0.0
    """Highest mean duty over the limits' window, 0..1."""
    pause_seconds: float = 0.0
    """Of rests, what the array's limits ask for beyond the plan's rests [s]."""
    faults: list[str] = field(default_factory=list)
    """Trials that exceed a limit whatever the pause before, once a block and fault."""

    def __repr__(self) -> str:
        """One line."""
        return f"ExpectedRun({self.participant}, {len(self.trials)} trials, {self.seconds / 60:.1f} min)"


def expected_run(
    plan: StudyPlan, participant: int, emissions: Mapping[str, EmissionInterval], *, is_longest: bool = False
) -> ExpectedRun:
    """A participant's run, if each screen takes the plan's `answer_seconds`.

    emissions: of each stimulus, by its name. is_longest: staircases have the most trials that they can have; otherwise
    as many as the mean of the fewest and the most. Each of their trials is of the level that drives the array hardest.
    """
    order = block_numbers(plan, participant)
    run = ExpectedRun(plan.codes[participant], tuple(plan.blocks[number].name for number in order))
    account, screen = DutyAccount(plan.limits), plan.answer_seconds
    now = screen * (bool(plan.welcome) + bool(plan.consent) + len(plan.questions_before))
    for block_number in order:
        block, began = plan.blocks[block_number], now
        now += screen * (1 + 2 * bool(block.practice))  # its instruction, and where practice begins and ends
        for number, (is_practice, stimuli) in enumerate(
            _trials(plan, block_number, participant, emissions, is_longest)
        ):
            planned = [replace(emissions[name], gap=block.gap if place else 0.0) for place, name in enumerate(stimuli)]
            pause = 0.0
            try:
                pause = account.pause_before(now, planned)
            except StudyError as error:
                if (fault := f"block {block.name}: {error}") not in run.faults:
                    run.faults.append(fault)
            rest = max(pause, block.rest)
            run.pause_seconds += rest - block.rest
            now += rest + READY_SECONDS
            onsets = []
            for own in planned:
                now += own.gap
                onsets.append(now)
                account.note(now, own.seconds, own.duty)
                now += own.seconds
                run.on_time_worst = max(run.on_time_worst, account.on_time())
                run.duty_worst = max(run.duty_worst, account.mean_duty(now))
            shown = None if block.design == "staircase" and not is_practice else stimuli
            run.trials.append(ExpectedTrial(block.name, number, is_practice, shown, tuple(onsets), rest))
            now += screen * len(block.questions)
        now += screen * len(block.questions_after)
        run.block_seconds[block.name] = now - began
    run.seconds = now + screen * len(plan.questions_after)
    return run


def _trials(
    plan: StudyPlan,
    block_number: int,
    participant: int,
    emissions: Mapping[str, EmissionInterval],
    is_longest: bool,
) -> Iterator[tuple[bool, tuple[str, ...]]]:
    """Whether each trial of a block is practice, and its stimuli."""
    block = plan.blocks[block_number]
    trials = trials_of(block, rng_of(plan, participant, block_number))
    if block.design != "staircase":
        yield from ((trial.is_practice, trial.stimuli) for trial in trials)
        return
    yield from ((True, next(trials).stimuli) for _ in range(block.practice))
    counts = trial_counts(block)
    count = counts.most if is_longest else (counts.least + counts.most + 1) // 2
    hardest = max(block.sets, key=lambda own: sum(emissions[name].duty * emissions[name].seconds for name in own))
    yield from ((False, hardest) for _ in range(count))
