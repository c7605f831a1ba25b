"""Pages of the docs site that are made from code when it is built; mkdocs.yml names this file as a hook.

The commands as their --help shows them, the public names of the packages as their docstrings do, and the notebooks,
which run for it: a notebook that fails ends the build.
"""

import ast
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))
import notebook_pages  # noqa: E402
import option_table  # noqa: E402

PACKAGES = ("kernels", "datasets", "device", "render")


@event_priority(100)  # before mkdocstrings reads it
def on_config(config: MkDocsConfig) -> None:
    """Give mkdocstrings a folder in which the packages lie as they are imported; an editable install has none."""
    names = Path(tempfile.mkdtemp(prefix="palpate-docs-")) / "palpate"
    names.mkdir()
    for package in PACKAGES:
        (names / package).symlink_to(ROOT / package)
    config.plugins["mkdocstrings"].config.handlers["python"]["paths"] = [str(names.parent)]  # type: ignore[attr-defined]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    made: dict[str, str | bytes] = {"reference/commands.md": commands()}
    for package in ("render", "datasets", "device"):
        made[f"reference/{package}.md"] = names_of(f"palpate.{package}")
    made["reference/kernels.md"] = kernels()
    for path in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        made |= {f"notebooks/{name}": content for name, content in notebook_pages.run(path).items()}
    for name, content in made.items():
        files.append(File.generated(config, name, content=content))
    return files


def names_of(package: str) -> str:
    """A page of the public names of a package: each where it is defined, classes and functions first, then errors."""
    module = import_module(package)
    found = {name: getattr(module, name) for name in module.__all__}
    told = [name for name, value in found.items() if callable(value)]
    errors = [name for name in told if isinstance(found[name], type) and issubclass(found[name], BaseException)]
    places = [f"::: {found[name].__module__}.{name}" for name in told if name not in errors]
    purpose = (module.__doc__ or "").partition("\n")[0]
    listed = "\n".join(f"| `{name}` | {(found[name].__doc__ or '').partition(chr(10))[0]} |" for name in errors)
    return (
        f"# Names in {package}\n\n{purpose}\n\n`from {package} import NAME`\n\n"
        + "\n\n".join(places)
        + (f"\n\n## Errors and warnings\n\n| name | means |\n|---|---|\n{listed}\n" if errors else "\n")
    )


def kernels() -> str:
    """A page of the host functions of the kernels, read and not imported."""
    rows = []
    for path in sorted((ROOT / "kernels").rglob("[!_]*.py")):
        name = "palpate." + ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for node in ast.parse(path.read_text()).body:
            text = isinstance(node, ast.FunctionDef) and not node.decorator_list and ast.get_docstring(node)
            if text and not node.name.startswith("_"):
                rows.append(_row(f"`{name}.{node.name}`", text.split("\n\n")[0]))
    text = "Functions that launch Warp kernels: arrays in, arrays out, on the device of what they are given."
    return f"# Kernels\n\n{text}\n\n| function | does |\n|---|---|\n" + "\n".join(rows) + "\n"


def commands() -> str:
    """A page with the help of every command."""
    parts = ["# Commands\n\n[command-line.md](../guide/command-line.md) explains what needs more than a line."]
    for name, command in option_table.commands():
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        usage = " ".join([f"palpate {name}", *(p.metavar for p in arguments), "[OPTIONS]"])
        rows = [_row(f"`{p.metavar}`", p.help or "") for p in arguments]
        rows += [_row(_names(p), p.help or "") for p in command.params if p not in arguments]
        text = (command.help or "").replace("\b", "").strip()
        parts.append(f"## palpate {name}\n\n```text\n{usage}\n```\n\n{text}\n\n| | |\n|---|---|\n" + "\n".join(rows))
    return "\n\n".join(parts) + "\n"


def _names(option: Any) -> str:
    names = ", ".join(f"`{name}`" for name in [*sorted(option.opts, key=len), *option.secondary_opts])
    return names if option.is_flag else f"{names} {option.metavar}"


def _row(names: str, text: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in (names, text)) + " |"
