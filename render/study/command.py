"""What `palpate study` does: judges the plan, opens the array and the pages, and runs one participant."""

import time
from contextlib import ExitStack
from typing import Any, cast, get_args

from ...device.link import TransportKind
from ...device.playing.signals import ending_on_signals
from ..errors import StudyPlanError
from ..intersection.named_inputs import load_solid
from ..live.session import Session
from ..live.sources.selection import ANY
from ..playback.file_playback import Connection
from ..playback.placed_arrays import load_rig
from ..runtime.warp_start import start_warp
from ..terminal import bars, console
from ..terminal.foreign_text import print_message
from ..validation import choose
from ..view.served.viewing import open_browser
from .pages.study_server import study_server
from .plan.duty_account import DutyAccount
from .plan.run_sheet import run_sheet
from .plan.study_judgement import StudyJudgement, judge_study
from .plan.study_plan import StudyPlan
from .plan.study_reading import read_study
from .run.answer_store import AnswerStore
from .run.desk import StudyDesk
from .run.interval_player import IntervalPlayer
from .run.study_run import StudyRun

LAST_SECONDS = 10.0  # [s] for which the last screen is shown, unless its page is closed before


def run_study(options: dict[str, Any], *, as_json: bool) -> int:
    """Judge the plan; then print its run sheet, or run one participant. Returns the exit code."""
    start_warp()
    plan = read_study(options["plan"])
    arrays = load_rig(
        options["array"], serial=options["serial"], calibration=options["calibration"], baud=options["baud"]
    )
    with bars.loading_bar(str(options["plan"]), quiet=as_json):
        judgement = judge_study(plan, arrays[0].model)
    if options["dry_run"]:
        return _print_sheet(plan, judgement, as_json=as_json)
    if judgement.faults:
        raise StudyPlanError(*judgement.faults)
    folder = options["data"] or options["plan"].with_suffix(".data")
    with ending_on_signals(), ExitStack() as stack:
        store = stack.enter_context(AnswerStore(folder, plan))
        code = options["participant"] or store.next_code()
        progress = store.begin(code, resume=options["resume"])
        outcome = "interrupted"
        try:
            outcome = _run_participant(plan, judgement, code, store, progress, arrays, options, stack, as_json=as_json)
        except KeyboardInterrupt:
            print_message("the array is off; go on with --resume", "note")
        counts = store.counts(code)
    console.show_values(
        {"participant": code, "outcome": outcome, **counts, "data": str(folder)}, as_json=as_json, title="study"
    )
    return console.DONE if outcome != "interrupted" else console.FAILED


def _print_sheet(plan: StudyPlan, judgement: StudyJudgement, *, as_json: bool) -> int:
    if as_json:
        write_output(console.json_line(judgement.as_dict()))
    else:
        write_output(run_sheet(plan, judgement))
    return console.FAILED if judgement.faults else console.DONE


def _run_participant(
    plan: StudyPlan,
    judgement: StudyJudgement,
    code: str,
    store: AnswerStore,
    progress: Progress,
    arrays: tuple[PlacedArray, ...],
    options: dict[str, Any],
    stack: ExitStack,
    *,
    as_json: bool,
) -> str:
    """Open the array and the pages, and run; returns what came of it."""
    desk = StudyDesk()
    solids = {own.name: load_solid(own.solid, own.placement) for own in plan.stimuli if own.solid is not None}
    shown_names, meshes = _shown_meshes(plan, solids)

    def warn(sentence: str) -> None:
        desk.set_status(warning=sentence)
        console.warn(sentence)

    session = Session(
        arrays,
        update_rate=judgement.update_rate,
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
    with session:
        with bars.loading_bar("stimuli", quiet=as_json):
            player = IntervalPlayer(session, plan, solids)
        store.begin_session(**_session_facts(session, arrays, options))
        server = stack.enter_context(study_server(desk, plan, session, meshes, port=options["port"]))
        send = _sender(stack, desk, plan, options, server.token)
        run = StudyRun(
            plan,
            code,
            store=store,
            progress=progress,
            desk=desk,
            player=player,
            account=DutyAccount(plan.limits),
            send=send,
            file_hashes=judgement.file_hashes,
            duties=judgement.duties,
            shown_names=shown_names,
        )
        _announce(server, options, as_json=as_json)
        outcome = run.run()
        end = time.monotonic() + LAST_SECONDS
        while desk.has_page and not desk.is_ended and time.monotonic() < end:
            desk.await_change(0.1)
    return outcome


def _announce(server: PageServer, options: dict[str, Any], *, as_json: bool) -> None:
    """Tell where the pages are, and open both."""
    addresses = {"participant": server.address("/"), "experimenter": server.address("/experimenter")}
    if as_json:
        write_output(console.json_line(addresses))
    else:
        print_message(f"the participant's page: {addresses['participant']}")
        print_message(f"the experimenter's page: {addresses['experimenter']}")
    if options["no_browser"]:
        return
    if not all([open_browser(own) for own in reversed(addresses.values())]):
        print_message("no browser could be opened here: open these addresses in one on this machine")
