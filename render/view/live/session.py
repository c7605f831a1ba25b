"""`palpate view` as a script calls it: opens files, starts the server, opens the browser, and ends with Ctrl-C."""

import contextlib
import threading
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path

from ...errors import ViewError
from ...playback.placed_arrays import load_rig
from ..file_scene import FileScene

FILES_MOST = 2


def serve_files(
    paths: Sequence[str | Path],
    *,
    port: int | None = None,
    array: str = "emulator",
    calibration: Path | None = None,
    ready: Callable[[str], object] | None = None,
    stop: threading.Event | None = None,
) -> None:
    """Show one contour file, or two side by side, on a local page until `stop` is set, or Ctrl-C.

    ready: called with the page's address once it can be opened. Raises ViewError for a port that is taken, for more
    than two files and where viser is not installed; ContourFileError for a file that cannot be read.
    """
    files = [Path(path) for path in paths]
    if not 1 <= len(files) <= FILES_MOST:
        raise ViewError(f"the viewer shows one file, or {FILES_MOST} side by side, not {len(files)}")
    try:
        from .guarded_server import HOST, start_server
        from .viewer import Viewer
    except ImportError as error:
        raise ViewError(f"the viewer needs viser ({error}): pip install 'palpate[view]'") from error
    arrays = load_rig(array, calibration=calibration)
    with contextlib.ExitStack() as stack:
        scenes = [stack.enter_context(FileScene(path)) for path in files]
        server = start_server("palpate", port)
        stack.callback(server.stop)
        viewer = Viewer(server, scenes, labels_of(files), arrays)
        if ready is not None:
            ready(f"http://{HOST}:{server.get_port()}")
        viewer.run(stop or threading.Event())


def labels_of(paths: Sequence[Path]) -> list[str]:
    """What files are called: their names, or their paths where the names are the same."""
    stems = [path.stem for path in paths]
    return stems if len(set(stems)) == len(stems) else [str(path) for path in paths]


def open_browser(address: str) -> bool:
    """Open a page in the visitor's browser; False where there is none, or no display."""
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False
