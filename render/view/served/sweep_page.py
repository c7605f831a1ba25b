"""The page of a sweep's table: sorted, searched, leafed through; one row, or two, open as renderings."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ...playback.placed_arrays import PlacedArray
from ...sweeps.report.table import column_units
from ...terminal.foreign_text import visible
from ...trust.permission import AllowCode
from ..file_scene import FileScene
from ..sweep_rows import SweepRows, cell_text, default_metrics
from .files_page import FilesPage
from .page_server import PageRequest, Send

PAGE_ROWS = 20
COLUMNS_MOST = 100


class SweepPage:
    """Answers for the table of a sweep's store, and for the rows that one browser has opened.

    folder: where rows that the sweep did not keep are rendered into.

    | a page asks | it gets |
    |---|---|
    | open, table: `by`, `falling`, `containing`, `columns`, `page` | a part of the table; open: its beginning |
    | rows: `numbers` | how many poses of them are rendered, then that they are open |
    | anything else | what `FilesPage` answers for the rows that are open |
    """

    slow = FilesPage.slow

    def __init__(
        self, rows: SweepRows, arrays: Sequence[PlacedArray], folder: Path, *, allow_code: AllowCode = False
    ) -> None:
        self._rows, self._arrays, self._folder, self._allow_code = rows, arrays, folder, allow_code
        self._opened, self._files = ExitStack(), None

    def close(self) -> None:
        """Close the rows that are open."""
        self._files = None
        self._opened.close()

    def answer(self, request: PageRequest, send: Send) -> None:
        """Answer one request; raises StrategyError for a request or a value that cannot be."""
        if request.ask == "table" or (request.ask == "open" and self._files is None):
            self.close()
            send(self._table(request), None)
        elif request.ask == "rows":
            self._open_rows(request, send)
        elif self._files is not None:
            self._files.answer(request, send)
        else:
            request.choice("ask", ("open", "table", "rows"))

    def _table(self, request: PageRequest) -> dict[str, Any]:
        rows = self._rows
        columns = request.values.get("columns", [])
        if not isinstance(columns, list) or len(columns) > COLUMNS_MOST:
            columns = []
        shown = default_metrics(rows.metrics)
        shown += [name for name in dict.fromkeys(map(str, columns)) if name in rows.metrics and name not in shown]
        by = request.choice("by", (*rows.axes, *rows.metrics)) if request.text("by") else None
        found = rows.ordered(by, falling=request.values.get("falling") is True, containing=request.text("containing"))
        last = max(0, (len(found) - 1) // PAGE_ROWS)
        page = min(int(request.number("page", 0, 1e9)) if request.has("page") else 0, last)
        listed = found[page * PAGE_ROWS : (page + 1) * PAGE_ROWS].tolist()
        names = [*rows.axes, *shown]
        units = column_units(names)
        return {
            "kind": "table",
            "title": visible(rows.store.name),
            "count": rows.count,
            "found": len(found),
            "page": page,
            "page_count": last + 1,
            "columns": [{"name": name, **_head(name, units.get(name, "1"))} for name in names],
            "more": [name for name in rows.metrics if name not in shown],
            "rows": [
                {"number": number, "cells": [visible(cell_text(rows.columns[name][number])) for name in names]}
                for number in listed
            ],
        }

    def _open_rows(self, request: PageRequest, send: Send) -> None:
        given = request.values.get("numbers")
        count = 2 if isinstance(given, list) and len(given) > 1 else 1
        numbers = request.integers("numbers", count, (self._rows.count,) * count)
        self.close()
        with ExitStack() as opened:
            scenes = []
            for number in numbers:
                file = self._rows.file_of(
                    number,
                    self._folder,
                    allow_code=self._allow_code,
                    progress=lambda done, poses: send({"kind": "progress", "done": done, "count": poses}, None),
                )
                scenes.append(opened.enter_context(FileScene(file)))
            self._opened = opened.pop_all()
        titles = [f"row {number}: {self._rows.title(number)}" for number in numbers]
        self._files = FilesPage(scenes, self._arrays, titles)
        self._files.answer(PageRequest({"ask": "open"}), send)


def _head(name: str, unit: str) -> dict[str, str]:
    return {"text": visible(name.replace("_", " ")), "unit": "" if unit == "1" else unit}
