"""Groups of commands whose help imports nothing that a command needs; what their parser refuses names the way out.

| refused | said besides |
|---|---|
| an argument or option is missing | what it is |
| a value is no number, or outside its bounds | the value, what is wanted, the bound |
| an option takes several values | which, and that blanks are between them |
| an option is unknown, and has another name here | that name |
| there are more arguments than the command takes | which it takes |
"""

import re
from collections.abc import Collection, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from ...datasets.known_names import find_name, likely_name
from ..terminal import console
from ..terminal.wording import Wording

RUN = "run"
WANTED = {"float": "no number", "int": "no whole number", "bool": "neither true nor false"}
BOUNDS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}
_SEVERAL = re.compile(r"Option '(-\S+)' requires (\d+) arguments")
COMPLETION = ("--install-completion", "--show-completion")
PLAN_KEYS = (
    "scale", "up", "fit", "rotate", "at", "kind", "level", "label", "inside", "spacing", "unit", "bounds", "solid",
    "weld", "fill_holes", "simplify", "palm", "duration", "rate", "seed", "model", "explorer", "facing", "workspace",
    "side", "alignment", "interpolate", "step", "flush", "speed", "update_rate", "solver", "amplitude", "slew",
    "sound_speed", "level_max",
)  # fmt: skip
"""Keys of a plan that are arguments in Python (those of the plan itself take long to import; a test compares them)."""


class CommandGroup(TyperGroup):
    """A group that names a command without looking at its own options."""

    plan_keys: Collection[str] = ()
    """Arguments that a plan's keys give, not options of its commands."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command, and have messages write arguments as its options."""
        args = [find_name(args[0], self.commands) or args[0], *args[1:]]
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            self.found = command
            others = [option.name for other in self.commands.values() for option in other.params]
            console.set_wording(Wording([option.name for option in command.params], others, self.plan_keys))
        return name, command, rest

    def invoke(self, ctx: Any) -> Any:
        """Run the command; what its parser refuses is explained."""
        self.found: Any = None
        try:
            return super().invoke(ctx)
        except Exception as error:
            if hasattr(error, "format_message") and not isinstance(self.found, CommandGroup | None):
                explain(error, self.found, self.commands)
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


class SweepGroup(PlanGroup):
    """Commands about stores; any other first word is a plan, or an option, of `run`."""

    plan_keys = PLAN_KEYS


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


def explain(error: Any, command: Any, commands: Mapping[str, Any]) -> None:
    """Complete the message of a parser's error on a command's arguments; commands: all of its group, by name."""
    parameter = getattr(error, "param", None)
    if hasattr(error, "param_type") and parameter is not None:  # one is missing
        error.message = f"It is: {parameter.help}" if parameter.help else ""
    elif parameter is not None and (faults := getattr(error.__cause__, "errors", None)) is not None:
        error.message = _fault(faults()[0], error.message, parameter)
    elif several := _SEVERAL.match(error.message):
        option = next(option for option in command.params if several[1] in option.opts)
        error.message = f"{several[1]} takes {several[2]} values, {option.metavar}, with blanks between: {option.help}"
    elif (name := getattr(error, "option_name", "")) and (
        having := [other for other, one in commands.items() if any(name in option.opts for option in one.params)]
    ):
        error.message, error.possibilities = f"{error.message}, which is of {', '.join(having)}", []
    elif error.message.startswith("Got unexpected extra argument"):
        taken = [one.metavar for one in command.params if one.param_type_name == "argument"]
        error.message = f"{error.message}: this command takes {' '.join(taken) or 'options only'}"


def _fault(fault: dict[str, Any], message: str, parameter: Any) -> str:
    """What is wrong with a value, which pydantic leaves out of its message."""
    value, bound = fault.get("input"), fault.get("ctx", {})
    kind = str(fault.get("type", "")).partition("_")[0]
    what = WANTED.get(kind)
    limits = [f"{word} {bound[name]}" for name, word in BOUNDS.items() if name in bound]
    if what is None and not limits:
        return message
    return f"{value!r} is {what}. {parameter.help}" if what else f"it must be {limits[0]}, not {value}"
