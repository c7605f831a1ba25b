"""Groups of commands whose help imports nothing that a command needs."""

from collections.abc import Collection, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from ....datasets.known_names import find_name, likely_name
from ...terminal import console
from ...terminal.wording import Wording

RUN = "run"
COMPLETION = ("--install-completion", "--show-completion")
OLD_NAMES = {
    "demo": {"--folder": "--out"},
    "selftest": {"--seconds": "--duration"},
    "bench": {"--strategies": "--strategy"},
}
"""Options that had another name; both are understood."""
LIKELY_COMMANDS = {
    **dict.fromkeys(("plot", "draw", "picture", "view"), "figure"),
    **dict.fromkeys(("show", "inspect", "describe", "cat"), "info"),
    **dict.fromkeys(("validate", "verify"), "check"),
    **dict.fromkeys(("stream", "run", "start"), "play"),
    **dict.fromkeys(("record", "intersect", "make"), "render"),
    **dict.fromkeys(("sample", "convert", "write"), "export"),
    **dict.fromkeys(("arrays", "boards", "scan"), "devices"),
    **dict.fromkeys(("list", "ls", "presets"), "strategies"),
    **dict.fromkeys(("benchmark", "time"), "bench"),
    **dict.fromkeys(("objects", "shapes"), "render --help"),
    "voxelize": "voxelise",
    **dict.fromkeys(("paper", "replicate", "evaluate"), "reproduce"),
    "test": "selftest",
}
"""Commands of ours by words of other programs."""


class CommandGroup(TyperGroup):
    """A group that names a command without looking at its own options."""

    plan_keys: Collection[str] = ()
    """Arguments that a plan's keys give, not options of its commands."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command, and have messages write arguments as its options."""
        args = [find_name(args[0], self.commands) or args[0], *args[1:]]
        if args[0] in LIKELY_COMMANDS and args[0] not in self.commands and not ctx.resilient_parsing:
            ctx.fail(f"No such command '{args[0]}'. Did you mean '{LIKELY_COMMANDS[args[0]]}'?")
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            self.found = command
            others = [option.name for other in self.commands.values() for option in other.params]
            console.set_wording(Wording([option.name for option in command.params], others, self.plan_keys))
        taking = {
            word
            for option in getattr(command, "params", ())
            if not getattr(option, "is_flag", True)
            for word in option.opts
        }
        return name, command, renamed(rest, OLD_NAMES.get(name or "", {}), taking)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; what its parser refuses is explained."""
        self.found: Any = None
        try:
            return super().invoke(ctx)
        except Exception as error:
            if hasattr(error, "format_message") and not isinstance(self.found, CommandGroup | None):
                import_module(".parser_errors", __package__).explain(error, self.found, self.commands)
            raise

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Leave out the group's --help where a command follows: typer imports pydantic for an option without value."""
        self.add_help_option = not (args and args[0] in self.commands)
        return super().parse_args(ctx, args)


class PlanGroup(CommandGroup):
    """A group whose first word is a plan, or an option of its hidden command `run`, unless it names another command."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put in `run`, which nobody writes, unless a shell completes the first word."""
        if ctx.resilient_parsing and not args:
            return super().parse_args(ctx, args)
        first = args[0] if args else RUN
        name = find_name(first, self.commands)
        meant = "" if "." in first or Path(first).exists() else likely_name(first, self.commands)
        if name is None and meant:
            ctx.fail(f"No such plan or command '{first}'{meant}.")
        return super().parse_args(ctx, [RUN, *args] if name is None else [name, *args[1:]])


class RunContext(TyperCommand.context_class):
    """Of `run`, whose name no help and no error shows."""

    @property
    def command_path(self) -> str:
        """What comes before the arguments."""
        return self.parent.command_path if self.parent else ""


class RunCommand(TyperCommand):
    """`run`."""

    context_class = RunContext


def renamed(args: list[str], new_names: Mapping[str, str], taking: Collection[str]) -> list[str]:
    """Arguments with options of old names under their new ones; taking: options whose next argument is their value."""
    out: list[str] = []
    for arg in args:
        name, *rest = arg.partition("=")
        is_value = "--" in out or (out and out[-1] in taking)
        out.append(arg if is_value else "".join((new_names.get(name, name), *rest)))
    return out


class MainGroup(CommandGroup):
    """All commands, --version, and completion by shells, whose options of typer's would have help import pydantic."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Print version or help if that is asked for; leave out typer's options for completion if they are not."""
        if not args or not args[0].startswith(COMPLETION):
            self.params = [option for option in self.params if not set(option.opts) & set(COMPLETION)]
        if args[:1] == ["help"]:
            args = [*args[1:], "--help"]
        if args[:1] in (["--version"], ["version"]):
            typer.echo(f"palpate {import_module('importlib.metadata').version('palpate')}")
            raise typer.Exit
        return super().parse_args(ctx, args)
