"""What a process that draws is started with, as bytes: an object, a hand and stages, user-defined ones among them."""

import io
import pickle
import pkgutil
import sys
import types
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import warp as wp

from ..errors import StrategyError
from ..stages.registry import Stage, StageEntry, find_stage, known_stages, register_stage
from ..strategies.intersection_strategy import IntersectionStrategy

UNPICKLABLE = (pickle.PickleError, AttributeError, ImportError, TypeError, ValueError)


def ship(settings: object, strategies: list[IntersectionStrategy]) -> bytes:
    """Settings as bytes, with the folders of the modules that they need and the user-defined stages of strategies.

    Raises StrategyError for what another process cannot import: code of the program that was started, lambdas.
    """
    stages = [("prune", own) for strategy in strategies for own in strategy.prune]
    stages += [("transform", own) for strategy in strategies for own in strategy.transform]
    entries = [find_stage(role, Stage.read(own, role).name) for role, own in stages]
    folders: list[str] = []
    parts = []
    for part in ([entry for entry in entries if not entry.own], settings):
        buffer = io.BytesIO()
        pickler = _Pickler(buffer, protocol=pickle.HIGHEST_PROTOCOL)
        try:
            pickler.dump(part)
        except StrategyError:
            raise
        except UNPICKLABLE as error:
            raise StrategyError(
                f"this cannot be given to the process that draws: {error}; put functions into a module of their own"
            ) from error
        folders += pickler.folders()
        parts.append(buffer.getvalue())
    return pickle.dumps((folders, *parts))


def unship(content: bytes) -> Any:
    """Settings from the bytes that `ship` made, in the process that draws; stages are registered first.

    Raises StrategyError where a module cannot be imported here.
    """
    # bytes of this user's own process, which started this one
    folders, stages, settings = pickle.loads(content)
    sys.path += [folder for folder in folders if folder not in sys.path]  # last: they hide no module of others
    try:
        entries: list[StageEntry] = pickle.loads(stages)
        for entry in entries:
            if entry.name not in known_stages(entry.role):  # importing its module may have registered it
                register_stage(entry)
        return pickle.loads(settings)
    except UNPICKLABLE as error:
        raise StrategyError(f"the process that draws cannot import what it needs: {error}") from error


class _Pickler(pickle.Pickler):
    """Names functions and classes by their modules, Warp functions too, and notes the modules."""

    def __init__(self, buffer: io.BytesIO, **options: Any) -> None:
        super().__init__(buffer, **options)
        self._modules: set[str] = set()

    def reducer_override(self, obj: Any) -> Any:
        """Refuse what stands in the program that was started; everything else is pickled as usual."""
        function = obj.func if isinstance(obj, wp.Function) else obj
        if isinstance(function, types.FunctionType | type):
            if function.__module__ == "__main__":
                raise StrategyError(
                    f"{function.__qualname__} is in the program that was started, which the process that draws cannot "
                    "import: put it into a module of its own"
                )
            self._modules.add(function.__module__.partition(".")[0])
        if isinstance(obj, wp.Function) and function is not None:
            return pkgutil.resolve_name, (f"{function.__module__}:{function.__qualname__}",)
        return NotImplemented

    def folders(self) -> list[str]:
        """Folders from which Python imports the modules, those of palpate and of Python left out."""
        found = []
        for name in self._modules - sys.stdlib_module_names - {"palpate"}:
            spec = find_spec(name)
            if spec is not None and spec.origin is not None:
                file = Path(spec.origin).resolve()
                found.append(str(file.parent.parent if spec.submodule_search_locations else file.parent))
        return sorted(set(found))
