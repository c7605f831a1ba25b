"""The server of a study's two pages."""

import threading
from collections.abc import Callable
from typing import Any

from ...live.moment import LiveMoment, LiveScene
from ...view.page.document import document
from ...view.served.page_server import PageServer, ServedPage
from ..run.desk import StudyDesk
from .experimenter_page import ExperimenterPage
from .participant_page import MeshOf, ParticipantPage

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
