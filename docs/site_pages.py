"""Pages of the docs site that are made from code when it is built; mkdocs.yml names this file as a hook.

The public names of the packages as their docstrings have them, the notebooks, which run for it (one that fails ends the
build), and a rendering as `palpate view --export` writes it, shown on the first page.
"""

import ast
import re
import sys
import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import typer.main
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from palpate.render import exploration, export_page, record
from palpate.render.cli.app import app

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))
import notebook_pages  # noqa: E402

RENDERING = "look/dog.html"
FRAME = (
    f'<iframe src="{RENDERING}" title="A dog explored by a palm, to turn and to play" loading="lazy" '
    'style="width: 100%; height: 36rem; border: 1px solid #9e9e9e"></iframe>\n\n'
    f"[The same on a page of its own]({RENDERING}), as `palpate view dog.h5 --export dog.html` writes it."
)
PACKAGES = ("kernels", "datasets", "device", "render")


@event_priority(100)  # before mkdocstrings reads it
def on_config(config: MkDocsConfig) -> None:
    """Give mkdocstrings a folder in which the packages lie as they are imported; an editable install has none."""
    names = Path(tempfile.mkdtemp(prefix="palpate-docs-")) / "palpate"
    names.mkdir()
    for package in PACKAGES:
        (names / package).symlink_to(ROOT / package)
    config.plugins["mkdocstrings"].config.handlers["python"]["paths"] = [
        str(names.parent)
    ]  # type: ignore[attr-defined]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    made: dict[str, str | bytes] = {RENDERING: rendering()}
    for package in ("render", "datasets", "device"):
        made[f"reference/{package}.md"] = names_of(f"palpate.{package}")
    made["reference/kernels.md"] = kernels()
    made["reference/commands.md"] = commands()
    for path in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        made |= {
            f"notebooks/{name}": content
            for name, content in notebook_pages.run(path).items()
        }
    for name, content in made.items():
        files.append(File.generated(config, name, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Put the rendering where the first page has a comment for it."""
    return (
        re.sub(r"<!-- A rendering .*? -->", lambda _: FRAME, markdown)
        if page.file.src_uri == "index.md"
        else markdown
    )


def rendering() -> str:
    """A palm that explores the dog for 8 s, drawn with closed contours, as one page that loads nothing."""
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "dog.h5", Path(folder) / "dog.html"
        record(
            path,
            "dog",
            "palm",
            exploration("dog", duration=8.0, rate=30.0, seed=1),
            "cc",
        )
        export_page(path, out)
        return out.read_text()


def names_of(package: str) -> str:
    """A page of the public names of a package: each where it is defined, classes and functions first, then errors."""
    module = import_module(package)
    found = {name: getattr(module, name) for name in module.__all__}
    told = [name for name, value in found.items() if callable(value)]
    errors = [
        name
        for name in told
        if isinstance(found[name], type) and issubclass(found[name], BaseException)
    ]
    places = [
        f"::: {found[name].__module__}.{name}" for name in told if name not in errors
    ]
    purpose = (module.__doc__ or "").partition("\n")[0]
    listed = "\n".join(
        f"| `{name}` | {(found[name].__doc__ or '').partition(chr(10))[0]} |"
        for name in errors
    )
    return (
        f"# Names in {package}\n\n{purpose}\n\n`from {package} import NAME`\n\n"
        + "\n\n".join(places)
        + (
            f"\n\n## Errors and warnings\n\n| name | means |\n|---|---|\n{listed}\n"
            if errors
            else "\n"
        )
    )


def commands() -> str:
    """A page of all commands: what each does, what it takes, and its options, as the dataclasses of them declare it."""
    parts = []
    for name, command in named_commands():
        rows = [
            _row(f"`{words}` {metavar}".strip(), text)
            for words, metavar, text in (
                (
                    ", ".join([*one.opts, *one.secondary_opts])
                    if one.param_type_name == "option"
                    else one.metavar,
                    ""
                    if one.param_type_name == "argument" or one.is_flag
                    else one.metavar,
                    one.help,
                )
                for one in command.params
            )
        ]
        table = "\n".join(["| argument or option | is |", "|---|---|", *rows])
        parts.append(f"## palpate {name}\n\n{command.help}\n\n{table}")
    return "# All commands and their options\n\n" + "\n\n".join(parts) + "\n"


def named_commands() -> Iterator[tuple[str, Any]]:
    """Every command by its name as one types it; `sweep PLAN` is its group's hidden command."""
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]  # a group's
        for part, inner in getattr(command, "commands", {"": command}).items():
            yield name if inner.hidden else f"{name} {part}".strip(), inner


def kernels() -> str:
    """A page of the host functions of the kernels, read and not imported."""
    rows = []
    for path in sorted((ROOT / "kernels").rglob("[!_]*.py")):
        name = "palpate." + ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for node in ast.parse(path.read_text()).body:
            text = (
                isinstance(node, ast.FunctionDef)
                and not node.decorator_list
                and ast.get_docstring(node)
            )
            if text and not node.name.startswith("_"):
                rows.append(_row(f"`{name}.{node.name}`", text.split("\n\n")[0]))
    text = "Functions that launch Warp kernels: arrays in, arrays out, on the device of what they are given."
    return (
        f"# Kernels\n\n{text}\n\n| function | does |\n|---|---|\n"
        + "\n".join(rows)
        + "\n"
    )


def _row(names: str, text: str) -> str:
    return (
        "| "
        + " | ".join(
            cell.replace("|", "\\|").replace("\n", " ") for cell in (names, text)
        )
        + " |"
    )
