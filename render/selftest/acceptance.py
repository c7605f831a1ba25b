"""`palpate selftest --acceptance`: a person's first hour with a real board (docs/guide/first-contact.md)."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

from ...device.errors import PlayInterrupted
from ...device.playing.signals import ending_on_signals
from ..errors import StrategyError
from ..playback.file_playback import CLOCKS, Connection
from ..playback.placed_arrays import PlacedArray, load_rig
from ..runtime.warp_start import start_warp
from ..terminal import console
from ..validation import choose
from .answers import AT_ALL_TIMES, InputEnded, Questioner, Reply
from .board import BoardSession
from .question import Answer, Step
from .report import AcceptanceReport, calibration_of, entry_of, machine
from .steps import steps_for


def run_acceptance(options: dict, *, as_json: bool) -> int:
    """Ask all steps of an array and write the report after each; the exit code says whether all was as expected.

    Raises StrategyError for options that mean nothing and for a script's line that is no answer, InputEnded,
    DeviceError and KeyboardInterrupt (PlayInterrupted) as they happen: the array is off and the report kept by then.
    """
    start_warp()
    placed, connection = _asked_for(options)
    questioner = Questioner()
    session = BoardSession(placed, connection, questioner.note)
    report = AcceptanceReport(
        options["acceptance"],
        overwrite=options["overwrite"],
        about={
            "array": placed.model.name,
            "serial": placed.serial or placed.model.serial,
            "emulated": session.emulated,
            "calibration": calibration_of(options["calibration"], placed.model),
            **machine(),
        },
    )
    steps = steps_for(placed.model)
    with _kept(report, questioner), ending_on_signals(), session:
        link = session.link
        report.write(serial=link.serial, transport=link.transport, clock=link.clock.name)
        questioner.note(f"{len(steps)} steps. At each question: {AT_ALL_TIMES}.")
        ended = _ask_all(steps, session, questioner, report)
        report.write(ended_by="quit" if not ended else "end")
    return _summarise(steps, report, questioner, as_json=as_json)


def _asked_for(options: dict) -> tuple[PlacedArray, Connection]:
    """The one array, and the way to it."""
    for name in ("height", "duration"):
        if options[name] is not None:
            raise StrategyError(f"--{name} means nothing with --acceptance, whose steps have their own")
    arrays = load_rig(
        options["array"], serial=options["serial"], calibration=options["calibration"], baud=options["baud"]
    )
    if len(arrays) != 1 or arrays[0].model.unplaced is not None:
        raise StrategyError(f"{options['array']}: --acceptance is of one array in its own frame: name it")
    if arrays[0].model.takes_points:
        raise StrategyError(
            f"--acceptance tries transducers one by one, which array {arrays[0].model.name} does not take: it takes "
            "focal points; leave the option out, and follow docs/how-to/ultraleap.md"
        )
    connection = Connection(
        emulate=options["emulate"],
        clock=choose("clock", options["clock"], tuple(CLOCKS)),
        watchdog=options["watchdog"],
        uncalibrated=options["uncalibrated"],
    )
    return arrays[0], connection


def _ask_all(steps: tuple[Step, ...], session: BoardSession, questioner: Questioner, report: AcceptanceReport) -> bool:
    """Ask step by step; False if a person ended it."""
    for number, step in enumerate(steps, 1):
        questioner.note(f"\n{number}/{len(steps)} {step.name}: {step.instruction}")
        entry = entry_of(step)
        report.steps.append(entry)
        reply = _reply(step, session, questioner, entry)
        if reply.answer is not None:
            entry |= {"answer": reply.answer.key, "as_expected": reply.answer.key == step.expected}
        entry["skipped_because"] = reply.skipped_because
        report.write()
        if reply.quits:
            return False
    return True


def _reply(step: Step, session: BoardSession, questioner: Questioner, entry: dict) -> Reply:
    """Play a step, as often as it is asked for, and ask."""
    while True:
        reply = questioner.ready(step)
        if reply is None:
            session.play(step, entry["played"])
            reply = questioner.ask(step)
        if not reply.again:
            return reply


@contextmanager
def _kept(report: AcceptanceReport, questioner: Questioner) -> Iterator[None]:
    """However it ends, the report says how, and the person where it is. What is misuse before anything was asked: none.

    The array is closed by then, so nothing plays while the file is written.
    """
    try:
        yield
    except KeyboardInterrupt as error:
        name = signal.Signals(error.signum).name if isinstance(error, PlayInterrupted) else str(error) or "SIGINT"
        report.write(ended_by=name, failure=str(error) or "interrupted")
        raise
    except InputEnded as error:
        report.write(ended_by="end of input", failure=str(error))
        raise
    except console.MISUSES as error:
        if report.steps:
            report.write(ended_by="misuse", failure=str(error))
        raise
    except Exception as error:
        report.write(ended_by="failure", failure=str(error))
        raise
    finally:
        if report.path.exists():
            answered = sum(entry["answer"] is not None for entry in report.steps)
            questioner.note(f"\nAnswers in the report: {answered} ({report.path})")


def _summarise(steps: tuple[Step, ...], report: AcceptanceReport, questioner: Questioner, *, as_json: bool) -> int:
    """Say which answers were not as expected and what each means; the exit code."""
    given = {str(entry["step"]): entry for entry in report.steps}
    unexpected: list[tuple[Step, Answer]] = []
    for step in steps:
        answer = step.answer(str(given.get(step.name, {}).get("answer")))
        if answer is not None and answer.key != step.expected:
            unexpected.append((step, answer))
            questioner.note(f"\n{step.name}: {answer.sentence} {answer.meaning} Change: {answer.change}")
    skipped = {name: str(entry["skipped_because"]) for name, entry in given.items() if entry["skipped_because"]}
    answered = [name for name, entry in given.items() if entry["answer"] is not None]
    missing = [step.name for step in steps if step.name not in answered and step.name not in skipped]
    values = {
        "report": str(report.path),
        "steps": len(steps),
        "answered": len(answered),
        "unexpected": [
            {"step": step.name, "answer": answer.key, "meaning": answer.meaning, "change": answer.change}
            for step, answer in unexpected
        ]
        if as_json
        else [f"{step.name} ({answer.key})" for step, answer in unexpected],
        "skipped": skipped if as_json else list(skipped),
        "not_asked": missing,
    }
    console.show_values(values, as_json=as_json, title="acceptance: what only hardware can tell")
    return console.FAILED if unexpected or skipped or missing else console.DONE
