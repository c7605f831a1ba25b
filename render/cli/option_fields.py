"""A command is a dataclass: its fields are the options, its docstring is the help, and `job` names what it runs.

The method `judge` of a command, and those of the classes that it inherits, raise what makes a request impossible. The
module of the work is imported afterwards, so that a command that must fail does not wait for Warp.

Typer reads a signature that is made from the fields. The option `spacing` is written `--spacing`, and `font_size` is
written `--font-size`. Options that several commands share stand in classes that these commands inherit.
"""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from functools import partial
from importlib import import_module
from typing import Annotated, Any, ClassVar, get_type_hints

import typer

from ..terminal import console
from ..validation import choose

REQUIRED = MISSING
"""The default of an option that must be given."""
PACKAGE = "palpate.render.cli"


def option(
    metavar: str,
    help: str,
    default: Any = None,
    *names: str,
    low: float | None = None,
    high: float | None = None,
    one_of: Sequence[str] = (),
    complete: Sequence[str] = (),
) -> Any:
    """A field that is an option with a value.

    names: its flags, where they are not only the field's name; low, high: bounds of a number; one_of: the words that it
    may be; complete: words that a shell completes, beside names of files.
    """
    words = completed(one_of or complete)
    made = partial(typer.Option, metavar=metavar, help=help, min=low, max=high, autocompletion=words)
    return _declared(made, default, names, one_of)


def switch(help: str, *names: str, default: bool = False) -> Any:
    """A field that is an option without a value."""
    return _declared(partial(typer.Option, help=help), default, names)


def argument(metavar: str, help: str, default: Any = REQUIRED, *, complete: Sequence[str] = ()) -> Any:
    """A field that is an argument; the order of arguments is that of their fields."""
    made = partial(typer.Argument, metavar=metavar, help=help, autocompletion=completed(complete))
    return _declared(made, default, None)


def completed(words: Sequence[str]) -> Callable[[str], list[str]] | None:
    """What gives a shell the words that begin as what is typed."""

    def beginning_so(incomplete: str) -> list[str]:
        return [word for word in words if word.startswith(incomplete.casefold())]

    return beginning_so if words else None


def _declared(made: Any, default: Any, names: Sequence[str] | None, one_of: Sequence[str] = ()) -> Any:
    metadata = {"made": made, "names": names, "one_of": tuple(one_of)}
    if isinstance(default, list):
        return field(default_factory=lambda: list(default), metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class Command:
    """The options that every command has, and what it runs."""

    job: ClassVar[str]
    """Module and function of the work, which are imported only once the options are judged."""
    quiet: bool = switch("No progress and no warnings; results and errors only.", "-q", "--quiet")
    json: bool = switch("Print one JSON object instead of a table.")

    given: ClassVar[tuple[str, ...]] = ()
    """Names of the options that the work is given one by one; without any, it is given this command."""

    def arguments(self) -> tuple[object, ...]:
        """What the work is given, beside `as_json`."""
        return tuple(getattr(self, name) for name in self.given) or (self,)

    def part(self, group: type) -> dict[str, Any]:
        """The options that a group of options declares, by their names."""
        return {name: getattr(self, name) for name in group.__annotations__}


class NamedOptions(Command):
    """A command whose work is given a dictionary of its options, for work that other callers have, too."""

    def arguments(self) -> tuple[object, ...]:
        """The options by their names."""
        return ({name: value for name, value in vars(self).items() if name not in ("json", "quiet")},)


def add_command(
    app: typer.Typer, kind: type[Command], name: str, short_help: str | None = None, **settings: Any
) -> None:
    """Add a command to an app of typer."""

    def run(**values: Any) -> None:
        def work() -> object:
            for name, one in by_name.items():
                if (known := one.metadata["one_of"]) and values[name] is not None:  # the known word, in any case
                    values[name] = choose(f"--{name.replace('_', '-')}", values[name], known)
            job = kind(**values)
            for group in kind.__mro__:  # a command's own options first, then those that it inherits
                if "judge" in vars(group):
                    group.judge(job)  # type: ignore[attr-defined]
            module, _, function = kind.job.partition(":")
            return getattr(import_module(module, PACKAGE), function)(*job.arguments(), as_json=job.json)

        raise typer.Exit(console.run(work, as_json=values["json"], quiet=values["quiet"]))

    by_name = {one.name: one for one in fields(kind)}
    hints = get_type_hints(kind)
    # The help shows a command's own options first, then those that it inherits.
    ordered = dict.fromkeys(name for group in kind.__mro__ for name in inspect.get_annotations(group))
    parameters = [_parameter(by_name[name], hints[name]) for name in ordered if name in by_name]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    app.command(name, help=kind.__doc__, short_help=short_help, **settings)(run)


def _parameter(one: "Field[Any]", hint: Any) -> inspect.Parameter:
    names, made = one.metadata["names"], one.metadata["made"]
    if names is not None and not any(name.startswith("--") for name in names):
        names = (*names, f"--{one.name.replace('_', '-')}")
    default = one.default if one.default_factory is MISSING else one.default_factory()
    return inspect.Parameter(
        one.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if default is MISSING else default,
        annotation=Annotated[hint, made(*names or ())],
    )
