"""The command line of trust: `palpate trust`, and the option that permits code this once."""

from typing import Annotated

import typer

from .output import Json, Quiet, run_job

AllowCode = Annotated[
    bool, typer.Option("--allow-code", help="Run code that strategy, object or plan names: docs/guide/trust.md.")
]
FILE_HELP = "Strategy (.json), plan (.toml), Python file, or package.module:function; read what they name first."


def trust(
    files: Annotated[list[str] | None, typer.Argument(metavar="FILE", help=FILE_HELP)] = None,
    remove: Annotated[
        list[str] | None, typer.Option("--remove", metavar="FILE|SHA256", help="Accept it no longer. May be repeated.")
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Accept the code that files name, or are, as it is now, and list all that is accepted; nothing is run."""
    run_job(".trust_commands", "run_trust", files or [], remove or [], json=json, quiet=quiet)
