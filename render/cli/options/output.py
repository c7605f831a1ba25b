"""Options that every command has, or every command that writes a file; and how a command runs."""

from importlib import import_module
from typing import Annotated, NoReturn

import typer

from ...terminal import console

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="No progress and no warnings; results and errors only.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what is there, once the new file is whole.")]


def run_job(module: str, name: str, *arguments: object, json: bool, quiet: bool, **options: object) -> NoReturn:
    """Exit with the code of a command, whose module is imported only now: --help need not wait for it."""

    def command() -> object:
        return getattr(import_module(module, "palpate.render.cli"), name)(*arguments, **options, as_json=json)

    raise typer.Exit(console.run(command, as_json=json, quiet=quiet))
