"""Groups of commands whose help imports nothing that a command needs."""

from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup


class CommandGroup(TyperGroup):
    """A group that names a command without looking at its own options."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Leave out the group's --help where a command follows: typer imports pydantic for an option without value."""
        self.add_help_option = not (args and args[0] in self.commands)
        return super().parse_args(ctx, args)


class MainGroup(CommandGroup):
    """All commands, and --version; as an option of typer's, too, it would have every help import pydantic."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Print the version if that is asked for."""
        if args[:1] == ["--version"]:
            typer.echo(f"palpate {import_module('importlib.metadata').version('palpate')}")
            raise typer.Exit
        return super().parse_args(ctx, args)
