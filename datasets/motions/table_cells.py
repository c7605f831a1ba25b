"""Lines and cells of a CSV as spreadsheets write them: commas, semicolons or tabs between, decimal points or commas.

| a spreadsheet writes                        | what happens                                                    |
|---------------------------------------------|-----------------------------------------------------------------|
| `sep=;`, `# comment`, blank above the header | passed over; `sep=` states the separator                        |
| `"0,1"` between commas                      | 0.1; `"1,000"` is refused, since it may be 1 or 1000            |
| empty cells behind the last column          | left out                                                        |
| UTF-16, or the letters of one language      | refused, naming the choice "CSV UTF-8"                          |
"""

import csv
import io
import re
from collections.abc import Iterable, Iterator
from typing import IO, NamedTuple

COMMA = ","
LINE_MOST = 1 << 20
"""Most characters of one line of text."""
_STATED = "sep="
_SEPARATORS = f"{COMMA};\t"
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


class Header(NamedTuple):
    """The line that names a table's columns; empty where there is none."""

    line: str
    separator: str
    number: int
    """Of the line, counted from 1; 0 where there is none."""


def text_lines(stream: IO[bytes]) -> Iterator[str]:
    """Lines of UTF-8 text, with or without a byte order mark; each ends with one LF, except perhaps the last.

    Raises ValueError, naming the line, for a line of more than LINE_MOST characters; UnicodeDecodeError.
    """
    with io.TextIOWrapper(stream, encoding="utf-8-sig") as lines:
        number = 1
        while line := lines.readline(LINE_MOST + 1):
            if len(line) > LINE_MOST:
                raise ValueError(f"line {number}: has more than {LINE_MOST} characters")
            yield line
            number += 1


def header_of(lines: Iterable[str]) -> Header:
    """The first line that is neither blank nor a comment nor states the separator; an iterator then goes on below."""
    stated = ""
    for number, line in enumerate(lines, start=1):
        text = line.strip('" \r\n')
        if text[:-1].lower() == _STATED and text[-1] in _SEPARATORS:
            stated = text[-1]
        elif line.strip() and not line.startswith("#"):
            return Header(line, stated or separator_of(line), number)
    return Header("", COMMA, 0)


def separator_of(header: str) -> str:
    """The separator of a CSV by its header's line: comma, semicolon or tab, whichever is there most often.

    Of as many the comma, after which some writers set a tab.
    """
    return max(_SEPARATORS, key=header.count)


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without quotes around them. Raises ValueError where a quote is not closed."""
    if '"' not in line:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))
    except csv.Error as error:
        raise ValueError(f"its quotes are not closed on the same line ({error})") from None


def without_empty_end(cells: list[str], count: int = 0) -> list[str]:
    """Cells without the blank ones at the end that follow the first `count`."""
    end = len(cells)
    while end > count and not cells[end - 1].strip():
        end -= 1
    return cells[:end]


def wrong_count(found: int, wanted: int, separator: str) -> str:
    """The sentence on a row that has not as many cells as the header; decimal commas make more."""
    decimal = separator == COMMA and wanted < found <= 2 * wanted
    return f"{found} columns, the header has {wanted}" + ("; decimal commas need semicolons between cells" * decimal)


def number_in(cell: str, separator: str) -> float:
    """The number in a cell; one comma is a decimal comma.

    Raises ValueError for anything else: Python's own digit separator `_`, which no file means, and, where commas
    separate cells, a comma that may separate thousands (`"1,000"`).
    """
    if "_" in cell or (separator == COMMA and _THOUSANDS.fullmatch(cell.strip())):
        raise ValueError(cell)
    return float(cell.replace(COMMA, "."))


def not_a_number(cell: str, column: str) -> str:
    """The sentence on a cell that `number_in` refuses."""
    way = ", or may be one of thousands: write decimal points" if _THOUSANDS.fullmatch(cell.strip()) else ""
    return f"{cell.strip()!r} in column {column} is not a number{way}"


def not_utf8(content: bytes) -> str:
    """The sentence on bytes that are not UTF-8: which is the first, and how to save them."""
    start = 0
    try:
        content.decode()
    except UnicodeDecodeError as error:
        start = error.start
    found = ", but UTF-16" if content.startswith(_UTF16_MARKS) else ""
    return f'byte {start} is not UTF-8 text{found}: save it as UTF-8 (a spreadsheet calls it "CSV UTF-8")'
