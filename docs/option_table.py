"""Writes docs/guide/options.md: which command has which option, read from the commands themselves.

Run it after a change of an option: `python docs/option_table.py`. A test compares the page with what this makes.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import typer.main

from palpate.render.cli.app import app

PAGE = Path(__file__).parent / "guide" / "options.md"
TITLE = """# Options of all commands

Made from the code by `python docs/option_table.py`. The same option has the same name, unit and meaning in every
command; where it does something else in some, each meaning follows the commands that have it.
[command-line.md](command-line.md) lists the commands and explains what needs more than a line.
"""


class Option(NamedTuple):
    """One option of one command."""

    command: str
    names: str
    takes: str
    help: str


def commands() -> Iterator[tuple[str, Any]]:
    """Every command by its name as one types it; `sweep PLAN` is its group's hidden command."""
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]  # a group's
        if not hasattr(command, "commands"):
            yield name, command
            continue
        for part, inner in command.commands.items():
            yield (name if inner.hidden else f"{name} {part}"), inner


def options() -> list[Option]:
    """Options of all commands."""
    return [
        Option(
            name,
            ", ".join(sorted(p.opts, key=len))
            + "".join(f"/{s}" for s in p.secondary_opts),
            _takes(p),
            p.help,
        )
        for name, command in commands()
        for p in command.params
        if not _is_argument(p)
    ]


def _takes(option: Any) -> str:
    """The word for an option's value; none for a switch."""
    return (
        ""
        if option.is_flag
        else option.metavar + (" (repeatable)" if option.multiple else "")
    )


def page() -> str:
    """The page as text: a row for each option; where its meanings differ, each with the commands that have it."""
    rows: dict[str, dict[tuple[str, str], list[str]]] = {}
    for option in options():
        meanings = rows.setdefault(option.names, {})
        meanings.setdefault((option.takes, option.help), []).append(option.command)
    everywhere = len(list(commands()))
    table = []
    for names, meanings in sorted(
        rows.items(), key=lambda row: row[0].rpartition("--")[2]
    ):
        texts = [
            f"**{'all' if len(having) == everywhere else ', '.join(having)}**: {text}"
            for (_, text), having in meanings.items()
        ]
        takes = " · ".join(dict.fromkeys(takes for takes, _ in meanings if takes))
        table.append(
            f"| {f'`{names}` {_cell(takes)}'.strip()} | {_cell(' '.join(texts))} |"
        )
    return (
        "\n".join([TITLE, "| option | commands: what it does |\n|---|---|", *table])
        + "\n"
    )


def _is_argument(parameter: Any) -> bool:
    return parameter.param_type_name == "argument"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page())
