"""A study's plan judged whole before it starts: balance, counts, minutes, the array's limits, and every stimulus."""

from dataclasses import asdict, dataclass
from typing import Any

from ....device.array import ArrayModel
from ....device.playing.limits import Limits
from ...trust.permission import AllowCode
from .block_designs import trial_counts
from .duty_account import EmissionInterval
from .expected_run import ExpectedRun, expected_run
from .latin_square import row_count, square_fault
from .stimulus_judgement import JudgedStimulus, PlacedSolids, judge_stimuli
from .study_plan import PlannedBlock, StudyPlan


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
