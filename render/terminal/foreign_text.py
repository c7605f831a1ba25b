"""The terminal: whatever a command shows goes through `visible`, since names, files and errors come from others.

A terminal obeys some characters instead of showing them: they set its title or clipboard, clear it, or begin a line
that looks like one of ours. Rich takes brackets for markup, and `:name:` for an emoji. So text reaches it as `plain`.
"""

from collections.abc import Iterable, Sequence
from typing import Literal

from rich.console import Console
from rich.table import Table
from rich.text import Text

errors = Console(stderr=True, highlight=False, soft_wrap=True)
"""Standard error."""

STYLES = {"error": "bold red", "warning": "yellow", "note": "yellow"}


def visible(text: object) -> str:
    """A text of one line, with escapes for all that is not shown as itself.

    Those are what `str.isprintable` denies: control characters (C0, C1, DEL), line and paragraph separators, characters
    that change the direction of writing or have no width, surrogates of bytes that are no UTF-8.
    """
    text = str(text)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def plain(text: object) -> Text:
    """The same for Rich, which then takes nothing in it for markup."""
    return Text(visible(text))


def print_message(text: object, kind: Literal["", "error", "warning", "note"] = "") -> None:
    """A line on standard error, begun with what kind of news it is."""
    errors.print(Text.assemble((f"{kind}: ", STYLES[kind]), visible(text)) if kind else plain(text))


def write(text: object) -> None:
    """A line on standard output."""
    Console(highlight=False, soft_wrap=True).print(plain(text))


def show_table(
    title: str, rows: Iterable[Sequence[object]], columns: Sequence[str] = (), *, to_errors: bool = False
) -> None:
    """A table on standard output, or standard error; without `columns` it has no head."""
    table = Table(title=plain(title), title_justify="left", show_header=bool(columns), box=None, padding=(0, 2, 0, 0))
    for name in columns:
        table.add_column(plain(name), overflow="fold")
    for row in rows:
        table.add_row(*map(plain, row))
    for column in table.columns:
        column.overflow = "fold"  # what is cut off may be what tells one file from another
    if to_errors:
        Console(highlight=False, stderr=True).print(table)
    else:
        Console(highlight=False, soft_wrap=True).print(table)
