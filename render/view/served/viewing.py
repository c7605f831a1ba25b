"""`palpate view` as a script calls it: opens files, starts the server, opens the browser, and ends with Ctrl-C."""

import contextlib
import os
import sys
import threading
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

from ....datasets.sweeps.merging import is_store
from ...contour_input import takes_batches
from ...errors import StrategyError, ViewError
from ...live.handle import Live
from ...playback.placed_arrays import PlacedArray, load_rig
from ...runtime.warp_start import start_warp
from ...terminal.foreign_text import print_message
from ...trust.permission import AllowCode
from ..file_scene import FileScene
from ..page.document import served_document
from ..page.export import FILES_MOST
from ..sweep_rows import SweepRows
from .files_page import FilesPage
from .live_page import LivePage
from .page_server import PageServer, ServedPage, ticket_address
from .sweep_page import SweepPage


@takes_batches
def view_files(
    paths: Sequence[str | Path],
    *,
    port: int | None = None,
    array: str = "emulator",
    calibration: Path | None = None,
    allow_code: AllowCode = False,
    ready: Callable[[str], object] | None = None,
    stop: threading.Event | None = None,
) -> None:
    """Show one contour file, two side by side, or a sweep's store on a local page until `stop` is set, or Ctrl-C.

    ready: called with the page's address once it can be opened. Raises ViewError for a port that is taken,
    StrategyError for more than two files, ContourFileError for a file that cannot be read.

    >>> from threading import Event
    >>> from palpate.render import render, static_pose, view_files
    >>> path, seen = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True), Event()
    >>> view_files([path], ready=lambda address: seen.set(), stop=seen)  # ends at once; without stop, by Ctrl-C
    >>> seen.is_set()
    True
    """
    files = [Path(path) for path in paths]
    if not 1 <= len(files) <= FILES_MOST:
        raise StrategyError(f"the viewer shows one file, or {FILES_MOST} side by side, not {len(files)}")
    arrays = load_rig(array, calibration=calibration)
    start_warp()
    with contextlib.ExitStack() as stack:
        if len(files) == 1 and is_store(files[0]):
            rows = SweepRows(files[0])
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="palpate-view-")))
            page = ServedPage(served_document, lambda: SweepPage(rows, arrays, folder, allow_code=allow_code))
        else:
            shown = FilesPage([stack.enter_context(FileScene(path)) for path in files], arrays)
            page = ServedPage(served_document, lambda: shown)
        server = stack.enter_context(PageServer({"/": page}, port))
        if ready is not None:
            ready(server.address())
        (stop or threading.Event()).wait()


class LiveViewer:
    """The server of a live run's page; use it in a `with`. It serves before there is a run, which it then follows.

    Raises ViewError for a port that is taken, StrategyError for a number of no port.
    """

    def __init__(self, port: int | None = None) -> None:
        self._page: LivePage | None = None
        self._server = PageServer({"/": ServedPage(served_document, self._converse)}, port)
        self.address = self._server.address()
        """Of the page."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._server.close()

    def follow(self, run: Live, arrays: Sequence[PlacedArray]) -> None:
        """Show this run from now on; arrays: shown under the hand."""
        run.scene()  # the outline of a volume takes seconds: now, and not while focal points go out
        self._page = LivePage(run.scene, run.moment, arrays)

    def _converse(self) -> LivePage:
        if self._page is None:
            raise ViewError("no live run has begun yet")
        return self._page


def announce(address: str, what: str, *, no_browser: bool) -> None:
    """Print a page's address, and open it; without a display or a browser, say what to do instead."""
    print_message(f"palpate shows {what} on {address} until Ctrl-C")
    if not no_browser and not open_browser(address):
        print_message(f"no browser could be opened here: open {address} in one on this machine")


def open_browser(address: str) -> bool:
    """Open a page in the visitor's browser; False where there is none, or no display."""
    if sys.platform == "linux" and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))):
        return False  # a browser of the terminal would be found, which draws nothing and takes the keyboard
    try:
        return webbrowser.open(ticket_address(address))
    except webbrowser.Error:
        return False
