"""Tables as files for other programs: CSV, and Parquet where PyArrow is installed; each is written whole or not at all.

The CSV has one line of names and no comments, so that R, spreadsheets and statistics programs read it without options.
"""

import math
import re
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ....datasets.storage.durable import write_file
from ...errors import RenderError

Value = str | float | bool | None
"""A cell; None and nan are missing."""

_FORMULA = re.compile(r"'*[=+\-@\t\r]")  # what begins a formula in spreadsheets; OWASP, "CSV Injection"
_NUMBER = re.compile(r"[+-]?[0-9]+(\.[0-9]*)?(e[+-]?[0-9]+)?", re.IGNORECASE)
_INT_MOST = 1 << 63


def write_tables(
    folder: Path, name: str, columns: Mapping[str, Sequence[Any]], *, units: Mapping[str, str] | None = None
) -> list[Path]:
    """Write equally long columns as NAME.csv and NAME.parquet, replacing earlier ones; returns what was written.

    A column with any text is text, else whole numbers, numbers or true and false. In the CSV a text that a spreadsheet
    would compute gets a `'` in front. units: of columns, kept in the Parquet file.

    Raises:
        RenderError: A file cannot be written; says why.
    """
    cells = {_clean(key): _column(values) for key, values in columns.items()}
    contents = {f"{name}.csv": _csv_content(cells)}
    if find_spec("pyarrow") is not None:
        contents[f"{name}.parquet"] = _parquet_content(
            cells, {_clean(key): unit for key, unit in (units or {}).items()}
        )
    for file, content in contents.items():
        try:
            write_file(folder / file, content)
        except OSError as error:
            raise RenderError(f"{folder / file}: cannot be written ({error.strerror or error})") from error
    return [folder / file for file in contents]


def _column(values: Sequence[Any]) -> list[Value]:
    """Values of one kind, or None."""
    plain = [own.item() if hasattr(own, "item") else own for own in values]  # NumPy's scalars
    found = [None if isinstance(own, float) and math.isnan(own) else own for own in plain]
    kinds = {type(own) for own in found if own is not None}
    if kinds <= {bool} or (kinds == {int} and all(own is None or -_INT_MOST <= own < _INT_MOST for own in found)):
        return found
    if kinds <= {bool, int, float}:
        return [None if own is None else float(own) for own in found]
    return [None if own is None else _clean(own if isinstance(own, str) else _number_text(own)) for own in found]


def _clean(text: str) -> str:
    """A text that files can hold: null characters and halves of surrogate pairs as escapes."""
    return text.replace("\0", "\\x00").encode(errors="backslashreplace").decode()


def _number_text(value: Any) -> str:
    """TRUE and FALSE, as R reads them, and no others, like pandas and polars; the same text for 7 and 7.0."""
    if isinstance(value, bool):
        return str(value).upper()
    return str(int(value)) if isinstance(value, float) and value.is_integer() and abs(value) < 1e15 else str(value)


def _csv_content(columns: Mapping[str, Sequence[Value]]) -> memoryview:
    def cell(value: Value) -> str:
        if not isinstance(value, str):
            return "" if value is None else _number_text(value)
        text = f"'{value}" if _FORMULA.match(value) and not _NUMBER.fullmatch(value) else value
        # The csv module of Python 3.11 leaves a lone carriage return without quotes.
        return '"' + text.replace('"', '""') + '"' if not text or any(own in text for own in ',"#\r\n') else text

    rows = [list(columns), *zip(*columns.values(), strict=True)]
    return memoryview("".join(f"{','.join(map(cell, row))}\n" for row in rows).encode())


def _parquet_content(columns: Mapping[str, Sequence[Value]], units: Mapping[str, str]) -> memoryview:
    import pyarrow as arrow
    from pyarrow import parquet

    types = {bool: arrow.bool_(), int: arrow.int64(), float: arrow.float64(), str: arrow.string()}
    fields = []
    for name, values in columns.items():
        kind = next((type(own) for own in values if own is not None), float)
        fields.append(arrow.field(name, types[kind], metadata={"units": units[name]} if name in units else None))
    sink = arrow.BufferOutputStream()
    parquet.write_table(arrow.table([list(own) for own in columns.values()], schema=arrow.schema(fields)), sink)
    return memoryview(sink.getvalue())
