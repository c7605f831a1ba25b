"""A study's plan judged whole before it starts: balance, counts, minutes, the array's limits, and every stimulus."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

from ....device.array import ArrayModel
from ....device.playing.limits import Limits
from ...errors import StudyError
from ...trust.permission import AllowCode
from .block_designs import block_numbers, rng_of, row_count, square_fault, trial_counts, trials_of
from .duty_account import DutyAccount, EmissionInterval
from .stimulus_judgement import JudgedStimulus, PlacedSolids, judge_stimuli
from .study_plan import PlannedBlock, StudyPlan

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


@dataclass(frozen=True, kw_only=True)
class JudgedBlock:
    """Numbers of a block."""

    name: str
    design: str
    practice: int
    """Trials whose answers do not count."""
    trials_least: int
    """Of the others; only a staircase may have more."""
    trials_most: int
    intervals_most: int
    """Of all its trials, practice included."""
    seconds: float
    """That it is expected to take, its pauses included [s]."""
    seconds_longest: float


@dataclass(frozen=True, kw_only=True)
class StudyJudgement:
    """What a plan amounts to. `faults` keep it from being run; `notes` do not."""

    title: str
    array: str
    update_rate: float
    """Of all stimuli [Hz]."""
    foci: int
    """Most focal points of a sample of any stimulus."""
    participants: tuple[ExpectedRun, ...]
    """Each one's run, as it is expected."""
    blocks: tuple[JudgedBlock, ...]
    """In the plan's order."""
    stimuli: tuple[JudgedStimulus, ...]
    is_balanced: bool
    """Whether each block comes equally often at each place and after each other one."""
    balance: str
    """A sentence on it."""
    trials_least: int
    """Of all blocks, practice included."""
    trials_most: int
    intervals_most: int
    seconds: float
    """Expected, of the participant with the longest run [s]."""
    seconds_longest: float
    """Of the longest run that staircases allow [s]."""
    limits: Limits
    on_time_worst: float
    """Longest emission without a pause that a run can have [s]."""
    duty_worst: float
    """Highest mean duty over `limits.duty_window` that a run can have, 0..1."""
    pause_seconds: float
    """That the limits add to the rests of the longest run [s]."""
    faults: tuple[str, ...]
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        """One line."""
        return (
            f"StudyJudgement({self.title!r}, {len(self.participants)} participants, {len(self.blocks)} blocks, "
            f"{self.seconds / 60:.1f} min, {len(self.faults)} faults)"
        )

    def as_dict(self) -> dict[str, Any]:
        """Everything, for JSON."""
        values = asdict(self)
        for run in values["participants"]:
            run["trials"] = [own._asdict() for own in run["trials"]]
            del run["faults"]  # they are among those of the plan
        return values


def judge_study(
    plan: StudyPlan, array: ArrayModel, *, allow_code: AllowCode = False, solids: PlacedSolids | None = None
) -> StudyJudgement:
    """Judge a plan for an array, which need not be there.

    allow_code: whether functions that are stimuli may run, as `load_solid` takes it. solids: gets all objects that
    could be loaded.
    """
    found = judge_stimuli(plan, array, allow_code=allow_code, solids=solids)
    emissions = {
        own.name: EmissionInterval(stimulus=own.name, seconds=own.emission_seconds, duty=own.duty)
        for own in found.stimuli
    }
    numbers = range(len(plan.codes))
    runs = [expected_run(plan, number, emissions) for number in numbers]
    longest = runs
    if any(block.design == "staircase" for block in plan.blocks):
        longest = [expected_run(plan, number, emissions, is_longest=True) for number in numbers]
    blocks = tuple(_judge_block(block, runs, longest) for block in plan.blocks)
    counts = [trial_counts(block) for block in plan.blocks]
    used = {name for block in plan.blocks for own in (*block.sets, (block.modulus or ())[:1]) for name in own}
    unused = [own.name for own in plan.stimuli if own.name not in used]
    is_balanced, balance = _balance(plan)
    return StudyJudgement(
        title=plan.title,
        array=array.name,
        update_rate=found.update_rate,
        foci=found.foci,
        participants=tuple(runs),
        blocks=blocks,
        stimuli=tuple(found.stimuli),
        is_balanced=is_balanced,
        balance=balance,
        trials_least=sum(own.practice + own.least for own in counts),
        trials_most=sum(own.practice + own.most for own in counts),
        intervals_most=sum(own.intervals_most for own in blocks),
        seconds=max(own.seconds for own in runs),
        seconds_longest=max(own.seconds for own in longest),
        limits=plan.limits,
        on_time_worst=max(own.on_time_worst for own in longest),
        duty_worst=max(own.duty_worst for own in longest),
        pause_seconds=max(own.pause_seconds for own in longest),
        faults=(*found.faults, *dict.fromkeys(fault for own in longest for fault in own.faults)),
        notes=(*found.notes, *(f"stimulus {name}: no block has it" for name in unused)),
    )


def _judge_block(block: PlannedBlock, runs: list[ExpectedRun], longest: list[ExpectedRun]) -> JudgedBlock:
    counts = trial_counts(block)
    intervals = [sum(len(own.onsets) for own in run.trials if own.block == block.name) for run in longest]
    return JudgedBlock(
        name=block.name,
        design=block.design,
        practice=counts.practice,
        trials_least=counts.least,
        trials_most=counts.most,
        intervals_most=max(intervals),
        seconds=max(run.block_seconds[block.name] for run in runs),
        seconds_longest=max(run.block_seconds[block.name] for run in longest),
    )


def _balance(plan: StudyPlan) -> tuple[bool, str]:
    """Whether the order of blocks is balanced over the participants, and a sentence on it."""
    blocks, participants = len(plan.blocks), len(plan.codes)
    if blocks == 1:
        return True, "there is one block, so its order needs no balance"
    if plan.block_order == "random":
        return False, "the order of blocks is drawn at random for each participant, so nothing balances it"
    if plan.block_order == "fixed":
        return False, "all participants have the blocks in the same order, so nothing balances it"
    if (fault := square_fault(blocks, participants)) is not None:
        return False, fault
    squares = participants // row_count(blocks)
    return True, (
        f"the order of blocks is balanced: {participants} participants fill the {row_count(blocks)} rows of a balanced "
        f"Latin square of {blocks} blocks {squares} time{'' if squares == 1 else 's'}"
    )
