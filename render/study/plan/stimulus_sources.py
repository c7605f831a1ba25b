"""Names and files of stimuli: looked up beside the plan, without opening contour files or loading meshes."""

from functools import partial
from pathlib import Path

from ....datasets.errors import DatasetError
from ....datasets.known_names import find_name, likely_file, likely_name
from ....datasets.shapes.built_in import shape_name, shape_names
from ...errors import RenderError
from ...intersection.named_inputs import HANDS
from ...sampling.presets import PRESETS as SAMPLINGS
from ...sampling.presets import load_sampling
from ...strategies.intersection_strategy import PRESETS as STRATEGIES
from ...strategies.intersection_strategy import load_strategy, strategy_name
from ...sweeps.plan.values import PlanFault, refuse


class StimulusSources:
    """Looks up what stimuli name; each name once. A name that stands for nothing raises PlanFault.

    Every method takes the text of the plan and returns the name itself, or the absolute path of the file.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()
        self._found: dict[tuple[str, str], str | PlanFault] = {}

    def find(self, key: str, text: str) -> str:
        """What a key of a plan names: `object`, `shown`, `strategy`, `sampling`, `hand` or `file`."""
        if (key, text) not in self._found:
            try:
                self._found[key, text] = _FINDERS[key](text, self.folder)
            except PlanFault as fault:
                self._found[key, text] = fault
        found = self._found[key, text]
        if isinstance(found, PlanFault):
            refuse(found.sentence)
        return found


def _file(text: str, folder: Path, what: str, known: tuple[str, ...] = ()) -> str:
    """The absolute path of a file; refused if there is none."""
    path = folder / text
    try:
        is_there = path.is_file()
    except OSError:  # such as a name that is too long
        is_there = False
    if not is_there:
        meant = likely_name(text, known) or likely_file(path)
        builtin = f"neither {what} ({', '.join(known)}) nor a file" if known else "no file"
        refuse(f"{text!r:.200} is {builtin} in {folder}{meant}")
    return str(path)


def _object(text: str, folder: Path) -> str:
    module, colon, function = text.rpartition(":")
    if colon and function.isidentifier():  # of a module, which is loaded when the study begins
        return f"{_file(module, folder, 'a module')}:{function}" if module.endswith(".py") else text
    return shape_name(text) or _file(text, folder, "a built-in object", shape_names())


def _strategy(text: str, folder: Path) -> str:
    if found := strategy_name(text):
        return found
    path = _file(text, folder, "a strategy", tuple(STRATEGIES))
    try:
        load_strategy(path)
    except (RenderError, DatasetError) as error:
        refuse(str(error))
    return path


def _sampling(text: str, folder: Path) -> str:
    if found := find_name(text, SAMPLINGS):
        return found
    path = _file(text, folder, "a sampling strategy", tuple(SAMPLINGS))
    try:
        load_sampling(path)
    except (RenderError, DatasetError) as error:
        refuse(str(error))
    return path


def _hand(text: str, folder: Path) -> str:
    return find_name(text, HANDS) or _file(text, folder, "a hand", HANDS)


_FINDERS = {
    "object": _object,
    "shown": _object,
    "strategy": _strategy,
    "sampling": _sampling,
    "hand": _hand,
    "file": partial(_file, what="a file"),
}
