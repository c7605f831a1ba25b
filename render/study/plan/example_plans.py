"""Plans of whole studies that palpate brings: the founding paper's user study and its pilot."""

from importlib.resources import files
from pathlib import Path

from ....datasets.storage.durable import NewFile
from ...errors import StudyError
from ...terminal import console
from ...validation import choose

EXAMPLES = ("paper", "pilot")
"""Names of the plans, in `examples/`."""


def example_text(name: str) -> str:
    """The text of an example's STUDY.toml.

    >>> from palpate.render.study.plan.example_plans import example_text
    >>> example_text("pilot").splitlines()[8]
    'title = "Infill density, pilot"'
    """
    return files(__package__).joinpath("examples", f"{name}.toml").read_text("utf-8")


def write_example(name: str, *, as_json: bool) -> None:
    """Write an example into the current folder; a file that is there is kept, and the command refused."""
    name = choose("example", name, EXAMPLES)
    path = Path(f"{name}.toml")
    try:
        with NewFile(path) as new:
            new.write(example_text(name).encode())
            new.publish(replaces=False)
    except FileExistsError as error:
        raise StudyError(f"{path} exists: move it away, or call this command in another folder") from error
    except OSError as error:
        raise StudyError(f"{path} cannot be written here: {error.strerror}") from error
    console.show_values({"plan": str(path)}, as_json=as_json, title="study example")
