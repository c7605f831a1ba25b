"""What `palpate study` does: judges the plan, opens the array and the pages, and runs one participant."""

import secrets
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any, cast, get_args

import numpy as np

from ...device.link import TransportKind
from ...device.playing.signals import ending_on_signals
from ..errors import StrategyError, StudyPlanError
from ..live.session import Session
from ..live.sources.pose_stream import ANY
from ..playback.file_playback import Connection
from ..playback.placed_arrays import PlacedArray, load_rig
from ..runtime.warp_start import start_warp
from ..terminal import bars, console
from ..terminal.foreign_text import print_message, write_output
from ..validation import choose
from ..view.served.page_server import PageServer
from ..view.served.viewing import open_browser
from .pages.experimenter_page import EXPERIMENTER, PARTICIPANT, study_server
from .plan.duty_account import DutyAccount, EmissionInterval
from .plan.run_sheet import run_sheet, run_sheet_values
from .plan.stimulus_judgement import PlacedSolids
from .plan.study_judgement import StudyJudgement, judge_study
from .plan.study_plan import StudyPlan
from .plan.study_reading import read_study
from .run.answer_store import AnswerStore
from .run.desk import ShownObject, StudyDesk
from .run.event_stream import EventStream, LslOutlet
from .run.interval_player import IntervalPlayer
from .run.study_file import ParticipantProgress, SessionSetup
from .run.study_run import ENDED, FINISHED, StudyRun

WARNINGS_SHOWN = 10
LAST_SECONDS = 10.0  # [s] for which the last screen is shown, unless its page is closed before
LEAST_SECONDS = 2.0  # [s] after which all pages have read that the run is over
INTERRUPTED = "interrupted"


def run_study(options: dict[str, Any], *, as_json: bool) -> int:
    """Judge the plan; then print its run sheet, or run one participant. Returns the exit code."""
    for name in ("events_host", "lsl"):
        if options["events"] is None and options[name] not in (False, "127.0.0.1"):
            raise StrategyError(f"--{name.replace('_', '-')} is of --events")
    if options["events"] is not None and not 1 <= options["events"] <= 65535:
        raise StrategyError(f"--events must be a port, 1 to 65535, not {options['events']}")
    start_warp()
    plan = read_study(options["plan"])
    arrays = load_rig(
        options["array"], serial=options["serial"], calibration=options["calibration"], baud=options["baud"]
    )
    solids: PlacedSolids = {}
    with bars.progress_bar(str(options["plan"]), quiet=as_json):
        judgement = judge_study(plan, arrays[0].model, allow_code=options["allow_code"], solids=solids)
    if options["dry_run"]:
        sheet = console.json_line(run_sheet_values(plan, judgement)) if as_json else run_sheet(plan, judgement)
        write_output(sheet)
        return console.MISUSED if judgement.faults else console.DONE
    if judgement.faults:
        raise StudyPlanError(*judgement.faults)
    folder = options["data"] or options["plan"].with_suffix(".data")
    setup = SessionSetup(
        array=", ".join(placed.model.name for placed in arrays),
        source=options["source"],
        hand=plan.hand,
        lead=options["lead"],
        realtime=options["realtime"],
        update_rate=judgement.update_rate,
    )
    if plan.block_order == "latin" and not judgement.is_balanced:
        console.warn(judgement.balance)
    if options["source"] == "exploration" and any(own.file is None for own in plan.stimuli):
        console.warn("the hand is a synthetic exploration, nobody's: give --source of your tracker for people's hands")
    with AnswerStore(folder, plan) as store:
        chosen = store.code_to_resume if options["resume"] else store.next_code
        code = options["participant"] or chosen()
        values = {own.name: own.value for own in plan.stimuli}
        store.keep_stimuli({own.name: (own.sha256, values[own.name]) for own in judgement.stimuli})
        progress = store.begin(code, resume=options["resume"], setup=setup)
        outcome = INTERRUPTED
        with ending_on_signals(), suppress(KeyboardInterrupt):
            outcome = _run_participant(plan, judgement, solids, store, progress, arrays, options, as_json=as_json)
        facts = {"participant": code, "outcome": outcome, **store.counts(code), "data": str(folder)}
    console.show_values(facts, as_json=as_json, title="study")
    if outcome in (INTERRUPTED, ENDED):
        print_message(f"the array is off; --participant {code} --resume goes on", "note")
    return console.FAILED if outcome == INTERRUPTED else console.DONE


def _run_participant(
    plan: StudyPlan,
    judgement: StudyJudgement,
    solids: PlacedSolids,
    store: AnswerStore,
    progress: ParticipantProgress,
    arrays: tuple[PlacedArray, ...],
    options: dict[str, Any],
    *,
    as_json: bool,
) -> str:
    """Open the array and the pages, and run; returns what came of it."""
    desk = StudyDesk()
    shown_names, mesh_of = _shown_meshes(plan, solids)

    warned: deque[str] = deque(maxlen=WARNINGS_SHOWN)

    def warn(sentence: str) -> None:
        warned.append(f"{time.strftime('%H:%M:%S')} {sentence}")
        desk.set_status(warnings=list(warned))
        console.warn(sentence)

    account = DutyAccount(plan.limits)
    for onset, seconds, driven in store.emissions(time.monotonic() - plan.limits.duty_window):
        account.note(onset, seconds, min(driven / seconds, 1.0))  # whoever felt it: the array is still warm

    with ExitStack() as stack:
        session = stack.enter_context(_open_session(plan, judgement, arrays, options, warn))
        with bars.progress_bar("stimuli", quiet=as_json):
            player = IntervalPlayer(session, plan, solids)
        server = stack.enter_context(
            study_server(
                desk, mesh_of, scene=session.scene, moment=session.moment, title=plan.title,
                language=plan.sentence("language"), lost=plan.sentence("lost"), noise_level=plan.noise_level,
                noise_seed=plan.seed, port=options["port"],
            )
        )  # fmt: skip
        events, send = {}, _send_nothing
        if options["events"] is not None:
            outlet = LslOutlet(f"palpate {plan.title}"[:100]) if options["lsl"] else None
            token = secrets.token_urlsafe(16)
            stream = stack.enter_context(
                EventStream(desk, host=options["events_host"], port=options["events"], token=token, outlet=outlet)
            )
            events, send = {"events": f"{stream.host}:{stream.port}", "token": token}, stream.send
        run = StudyRun(
            plan,
            progress.code,
            store=store,
            progress=progress,
            desk=desk,
            player=player,
            account=account,
            send=send,
            file_hashes={own.name: own.sha256 for own in judgement.stimuli if own.sha256 is not None},
            emissions={
                own.name: EmissionInterval(stimulus=own.name, seconds=own.emission_seconds, duty=own.duty)
                for own in judgement.stimuli
            },
            shown_names=shown_names,
            seconds=judgement.seconds,
        )
        desk.set_status(array=", ".join(placed.model.name for placed in arrays), title=plan.title)
        store.note_array(lead=session.lead, realtime=session.statistics().realtime)
        session.scene()  # an outline of a volume takes seconds, after which the page would count as lost
        _announce(server, events, options, as_json=as_json)
        outcome = run.run()
        desk.set_status(outcome=outcome)
        end = time.monotonic() + (LAST_SECONDS if outcome == FINISHED else 0.0)
        least = time.monotonic() + LEAST_SECONDS
        while time.monotonic() < least or (desk.has_page and time.monotonic() < end):
            desk.await_change(0.1)
    return outcome


def _open_session(
    plan: StudyPlan,
    judgement: StudyJudgement,
    arrays: tuple[PlacedArray, ...],
    options: dict[str, Any],
    warn: Callable[[str], object],
) -> Session:
    return Session(
        arrays,
        update_rate=judgement.update_rate,
        foci=judgement.foci,
        source=options["source"],
        lead=options["lead"],
        limits=plan.limits,
        realtime=options["realtime"],
        told=warn,
        side=options["side"] or ANY,
        alignment=options["alignment"],
        prediction=options["prediction"],
        smoothing=options["smoothing"],
        allow_code=options["allow_code"],
        connection=Connection(
            emulate=options["emulate"],
            transport=cast("TransportKind", choose("transport", options["transport"], get_args(TransportKind))),
            uncalibrated=options["uncalibrated"],
            watchdog=options["watchdog"],
        ),
    )


def _shown_meshes(
    plan: StudyPlan, loaded: PlacedSolids
) -> tuple[dict[str, str], Callable[[ShownObject], tuple[np.ndarray, np.ndarray]]]:
    """The name of the mesh that is seen with each stimulus, and what gives vertices and faces of it."""
    numbers = {key: str(number) for number, key in enumerate(loaded)}  # a name would reveal how it is rendered
    solids = {numbers[key]: solid for key, solid in loaded.items()}
    names = {}
    for own in plan.stimuli:
        seen = own.shown or own.solid
        if seen is not None:
            names[own.name] = numbers[seen, own.placement]
    return names, lambda shown: solids[shown.solid].outline_mesh()


def _announce(server: PageServer, events: dict[str, str], options: dict[str, Any], *, as_json: bool) -> None:
    """Print where the pages are, and open both."""
    addresses = {"participant": server.address(PARTICIPANT), "experimenter": server.address(EXPERIMENTER)}
    if as_json:
        write_output(console.json_line({"pages": addresses, **events}))
    else:
        for name, address in addresses.items():
            print_message(f"the {name}'s page: {address}")
        if events:
            print_message(f"events: {events['events']}, token {events['token']}")
    if options["no_browser"]:
        return
    are_open = [open_browser(address) for address in reversed(addresses.values())]  # the participant's is on top
    if not all(are_open):
        print_message("no browser could be opened here: open these addresses in one on this machine")


def _send_nothing(name: str, **values: Any) -> None:
    """Events go to no other program."""
