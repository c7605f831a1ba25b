"""A sweep's table on the page: sorted, searched, leafed through; one row, or two, open as renderings."""

import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from ....datasets.errors import DatasetError
from ....device.errors import DeviceError
from ...errors import RenderError
from ...playback.placed_arrays import PlacedArray
from ...sweeps.report.table import column_units
from ...trust.permission import AllowCode
from ..file_scene import FileScene
from ..sweep_rows import SweepRows, cell_text, default_metrics
from .guarded_server import GuardedServer
from .numbers import STYLE, failure_html, safe
from .viewer import Viewer

PAGE_ROWS = 15
UNSORTED = "as in the table"
PROBLEMS = (RenderError, DatasetError, DeviceError, OSError)
"""What is said on the page, and does not end it."""


class SweepPage:
    """The page of a sweep's store."""

    def __init__(
        self, server: GuardedServer, rows: SweepRows, arrays: Sequence[PlacedArray], *, allow_code: AllowCode
    ) -> None:
        self._server, self._rows, self._arrays, self._allow_code = server, rows, arrays, allow_code
        self._order = rows.ordered()
        self._page = 0
        self._by, self._falling, self._containing = UNSORTED, False, ""
        self._shown = default_metrics(rows.metrics)
        self._tasks: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._opened: list[int] | None = None

    def run(self, stop: threading.Event) -> None:
        """Show the table, and the rows that the visitor opens, until `stop` is set."""
        with TemporaryDirectory(prefix="palpate-view-") as folder:
            while not stop.is_set():
                self._show_table(stop)
                if self._opened is not None and not stop.is_set():
                    self._show_rows(self._opened, Path(folder), stop)

    def _show_table(self, stop: threading.Event) -> None:
        """Show the table until rows are opened: then `_opened` has their numbers."""
        self._opened = None
        self._build()
        self._fill()
        while not stop.is_set() and self._opened is None:
            try:
                self._tasks.get(timeout=0.2)()
            except queue.Empty:
                continue
            except PROBLEMS as error:
                self._message.content = failure_html(str(error))

    def _build(self) -> None:
        gui, put = self._server.gui, self._tasks.put
        gui.reset()
        self._server.scene.reset()
        gui.add_html(f'<div style="{STYLE}"><b>{safe(self._rows.store.name)}</b>: {self._rows.count:,} rows</div>')
        by = gui.add_dropdown("sort by", (UNSORTED, *self._rows.axes, *self._rows.metrics), initial_value=self._by)
        falling = gui.add_checkbox("largest first", self._falling)
        search = gui.add_text("contains", self._containing)
        columns = gui.add_dropdown("also show", ("-", *self._rows.metrics), initial_value="-")
        self._table = gui.add_html("")
        turn = gui.add_button_group("page", ("first", "back", "next", "last"))
        numbers = gui.add_text("rows to open", "", hint="The number of one row, or of two with a comma between, as 3,5")
        open_rows = gui.add_button("open")
        self._message = gui.add_html("")

        def sort(_: object) -> None:
            self._by, self._falling, self._containing, self._page = by.value, falling.value, search.value, 0
            put(self._fill)

        def add(_: object) -> None:
            if columns.value != "-" and columns.value not in self._shown:
                self._shown.append(columns.value)
                put(self._fill)

        def leaf(_: object) -> None:
            last = max(0, (len(self._order) - 1) // PAGE_ROWS)
            page = {"first": 0, "back": self._page - 1, "next": self._page + 1, "last": last}[turn.value]
            self._page = min(max(page, 0), last)
            put(self._fill)

        for handle in (by, falling, search):
            handle.on_update(sort)
        columns.on_update(add)
        turn.on_click(leaf)
        open_rows.on_click(lambda _: put(lambda: self._choose(numbers.value)))

    def _fill(self) -> None:
        by = None if self._by == UNSORTED else self._by
        self._order = self._rows.ordered(by, falling=self._falling, containing=self._containing)
        part = self._order[self._page * PAGE_ROWS : (self._page + 1) * PAGE_ROWS]
        self._table.content = table_html(self._rows, part.tolist(), [*self._rows.axes, *self._shown])

    def _choose(self, text: str) -> None:
        """Take numbers of rows; say what is wrong with others."""
        try:
            numbers = [int(part) for part in text.split(",")]
        except ValueError:
            numbers = []
        if not 1 <= len(numbers) <= 2 or not all(0 <= number < self._rows.count for number in numbers):
            wanted = f"one number of 0..{self._rows.count - 1}, or two with a comma between"
            self._message.content = failure_html(f"rows to open must be {wanted}, not {text!r}")
            return
        self._opened = numbers

    def _show_rows(self, numbers: Sequence[int], folder: Path, stop: threading.Event) -> None:
        """Show rows as renderings until the visitor goes back."""
        back = threading.Event()
        gui = self._server.gui
        gui.reset()
        self._server.scene.reset()
        gui.add_button("back to the table").on_click(lambda _: back.set())
        progress = gui.add_progress_bar(0.0)
        message = gui.add_html("")
        try:
            with ExitStack() as opened:
                scenes = []
                for number in numbers:
                    file = self._rows.file_of(
                        number,
                        folder,
                        allow_code=self._allow_code,
                        progress=lambda done, count: setattr(progress, "value", 100.0 * done / max(count, 1)),
                    )
                    scenes.append(opened.enter_context(FileScene(file)))
                progress.remove()
                titles = [self._rows.title(number) for number in numbers]
                Viewer(self._server, scenes, [f"row {number}" for number in numbers], self._arrays, titles).run(
                    stop, back
                )
        except PROBLEMS as error:
            message.content = failure_html(str(error))
            while not (back.wait(0.2) or stop.is_set()):
                continue


def table_html(rows: SweepRows, numbers: Sequence[int], columns: Sequence[str]) -> str:
    """Rows of a table as HTML."""
    units = column_units(columns)
    heads = [name.replace("_", " ") + (f" [{units[name]}]" if units.get(name, "1") != "1" else "") for name in columns]
    head = "".join(f"<th style='text-align:left'>{safe(text)}</th>" for text in ("row", *heads))
    lines = [
        f"<tr><td><b>{number}</b></td>"
        + "".join(f"<td>{safe(cell_text(rows.columns[name][number]))}</td>" for name in columns)
        + "</tr>"
        for number in numbers
    ]
    body = "".join(lines) or f"<tr><td colspan={len(columns) + 1}>no row contains that</td></tr>"
    return f'<div style="{STYLE};overflow-x:auto"><table><tr>{head}</tr>{body}</table></div>'
