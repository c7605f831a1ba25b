"""`palpate view` as a script calls it: opens files, starts the server, opens the browser, and ends with Ctrl-C."""

import contextlib
import threading
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path

from ....datasets.sweeps.check import is_sweep_data
from ...contour_input import takes_batches
from ...errors import StrategyError, ViewError
from ...playback.placed_arrays import load_rig
from ...reports.rendering_labels import labels_of
from ...trust.permission import AllowCode
from ..file_scene import FileScene
from ..sweep_rows import SweepRows

FILES_MOST = 2


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

    ready: called with the page's address once it can be opened. Raises ViewError for a port that is taken and where
    viser is not installed, StrategyError for more than two files, ContourFileError for a file that cannot be read.

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
    is_store = len(files) == 1 and files[0].is_dir() and is_sweep_data(files[0])
    try:
        from .guarded_server import HOST, start_server
        from .sweep_page import SweepPage
        from .viewer import Viewer
    except ImportError as error:
        raise ViewError(f"the viewer needs viser ({error}): pip install -e '.[view]' in palpate's folder") from error
    arrays = load_rig(array, calibration=calibration)
    with contextlib.ExitStack() as stack:
        scenes = [] if is_store else [stack.enter_context(FileScene(path)) for path in files]
        rows = SweepRows(files[0]) if is_store else None
        server = start_server("palpate", port)
        stack.callback(server.stop)
        if rows is None:
            page = Viewer(server, scenes, labels_of([scene.file for scene in scenes]), arrays)
        else:
            page = SweepPage(server, rows, arrays, allow_code=allow_code)
        if ready is not None:
            ready(f"http://{HOST}:{server.get_port()}")
        page.run(stop or threading.Event())


def open_browser(address: str) -> bool:
    """Open a page in the visitor's browser; False where there is none, or no display."""
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False
