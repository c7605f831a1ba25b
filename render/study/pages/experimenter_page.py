"""The experimenter's page: how the run goes, what the participant sees, and stop."""

import contextlib
import math
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ....device.errors import DeviceError
from ...errors import RenderError
from ...live.moment import LiveMoment, LiveScene
from ...view.page.document import document
from ...view.served.page_server import PageRequest, PageServer, Send, ServedPage
from ..run.desk import Screen, StudyDesk
from .participant_page import MeshOf, ParticipantPage, visible_lines

LIST_MOST = 100  # entries of a list that is shown: the last ones
TEXT_MOST = 2000  # characters of a text
DEPTH_MOST = 4


class ExperimenterPage:
    """Answers about the run; any number of browsers may show it.

    moment: `Session.moment`, or None.

    | a page asks | it gets |
    |---|---|
    | progress | the run's status, the participant's screen, and the live state |
    | stop, go_on, end | the same, after the desk has done it |
    """

    slow = frozenset({"progress", "stop", "go_on", "end"})
    """All of them: stop waits for nothing that another page asks."""

    def __init__(self, desk: StudyDesk, moment: Callable[[], LiveMoment | None] | None = None) -> None:
        self._desk, self._moment = desk, moment

    def __repr__(self) -> str:
        """One line."""
        return f"ExperimenterPage({'live' if self._moment else 'no live state'})"

    def close(self) -> None:
        """Nothing: the run goes on without the experimenter's page."""

    def answer(self, request: PageRequest, send: Send) -> None:
        """Answer one request; raises StrategyError for any other."""
        match request.choice("ask", ("progress", "stop", "go_on", "end")):
            case "stop":
                self._desk.stop("the experimenter has stopped it")
            case "go_on":
                self._desk.go_on()
            case "end":
                self._desk.end()
        status = self._desk.status()
        send({"kind": "run", "status": plain(status | self._live()), "screen": _described(self._desk.shown)}, None)

    def _live(self) -> dict[str, Any]:
        moment = None
        with contextlib.suppress(RenderError, DeviceError):
            moment = self._moment() if self._moment is not None else None
        if moment is None:
            return {}
        late = [None if math.isnan(value) else value for value in (moment.latency.p50, moment.latency.p99)]
        return {"live": moment.state, "latency": late, "frames": moment.frames, "dropped": moment.dropped}


def _described(screen: Screen) -> dict[str, Any]:
    """The participant's screen in words."""
    return {
        "kind": screen.kind,
        **{name: visible_lines(getattr(screen, name))[:TEXT_MOST] for name in ("title", "text", "hint")},
        "keys": [f"{'space' if own.key == ' ' else own.key}: {visible_lines(own.label)}" for own in screen.keys],
        "question": "" if screen.question is None else visible_lines(screen.question.text)[:TEXT_MOST],
        "progress": screen.progress,
    }


def plain(value: Any, depth: int = 0) -> Any:
    """A value of the run's status as JSON takes it: numbers that are none become None, what is unknown a text."""
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str | Path) or depth > DEPTH_MOST:
        return visible_lines(str(value))[:TEXT_MOST]
    if isinstance(value, dict):
        return {visible_lines(str(name)): plain(own, depth + 1) for name, own in value.items()}
    if isinstance(value, list | tuple):
        return [plain(own, depth + 1) for own in value[-LIST_MOST:]]
    if hasattr(value, "tolist"):
        return plain(value.tolist(), depth + 1)  # of NumPy
    return visible_lines(str(value))[:TEXT_MOST]


# ---- The server of a study's two pages


PARTICIPANT, EXPERIMENTER = "/", "/experimenter"
LOST = "The connection is lost. Please tell the experimenter."


def study_server(
    desk: StudyDesk,
    mesh: MeshOf,
    *,
    scene: Callable[[], LiveScene | None] = lambda: None,
    moment: Callable[[], LiveMoment | None] = lambda: None,
    title: str = "palpate study",
    language: str = "en",
    lost: str = LOST,
    noise_level: float = 0.0,
    noise_seed: int = 0,
    port: int | None = None,
) -> PageServer:
    """Serve a study's pages; close it at the run's end. `address(PARTICIPANT)` and `address(EXPERIMENTER)` lead there.

    scene, moment: `Session.scene`, `Session.moment`. mesh: what is drawn of an object. language: of the participant's
    words, as HTML's `lang`. lost: what the participant reads when the connection is lost. noise_level: of the masking
    noise, 0..1 of full scale. Raises ViewError for a port that is taken, StrategyError for a number of no port.
    """
    turn = threading.Lock()

    def one_moment() -> LiveMoment | None:
        with turn:  # both pages ask, from threads of their own
            return moment()

    participant = ParticipantPage(desk, scene, one_moment, mesh, noise_level=noise_level, noise_seed=noise_seed)
    described: dict[str, Any] = {"served": True, "page": "participant", "lost": lost}
    pages = {
        PARTICIPANT: ServedPage(
            lambda sockets: document(described, "", title, sockets, language), participant.visit
        ),
        EXPERIMENTER: ServedPage(
            lambda sockets: document({"served": True, "page": "experimenter"}, "", f"{title}: experimenter", sockets),
            lambda: ExperimenterPage(desk, one_moment),
        ),
    }  # fmt: skip
    return PageServer(pages, port)
