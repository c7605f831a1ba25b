"""What another process of a live run is started with, as bytes: an object, a hand, a source, user-defined code."""

import io
import pickle
import pkgutil
import sys
import types
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ...errors import StrategyError

UNPICKLABLE = (pickle.PickleError, AttributeError, ImportError, TypeError, ValueError)


def ship(settings: object) -> bytes:
    """Settings as bytes, with the folders of the modules that they need.

    Raises StrategyError for what another process cannot import: code of the program that was started, lambdas.
    """
    buffer = io.BytesIO()
    pickler = _Pickler(buffer, protocol=pickle.HIGHEST_PROTOCOL)
    try:
        pickler.dump(settings)
    except UNPICKLABLE as error:
        raise StrategyError(
            f"this cannot be given to another process: {error}; put functions and classes into a module of their own"
        ) from error
    return pickle.dumps((pickler.folders(), buffer.getvalue()))


def unship(content: bytes) -> Any:
    """Settings from the bytes that `ship` made, in the process that was started.

    Raises StrategyError where a module cannot be imported here.
    """
    # bytes of this user's own process, which started this one
    folders, settings = pickle.loads(content)
    sys.path += [folder for folder in folders if folder not in sys.path]  # last: they hide no module of others
    try:
        return pickle.loads(settings)
    except UNPICKLABLE as error:
        raise StrategyError(f"the process that was started cannot import what it needs: {error}") from error


class _Pickler(pickle.Pickler):
    """Names functions and classes by their modules, Warp functions too, and notes the modules."""

    def __init__(self, buffer: io.BytesIO, **options: Any) -> None:
        super().__init__(buffer, **options)
        self._modules: set[str] = set()
        self._warp = sys.modules.get("warp")  # who has none of its functions need not import it: a source starts sooner

    def reducer_override(self, obj: Any) -> Any:
        """Refuse what stands in the program that was started; everything else is pickled as usual."""
        is_kernel_function = self._warp is not None and isinstance(obj, self._warp.Function)
        function = obj.func if is_kernel_function else obj
        if isinstance(function, types.FunctionType | type):
            if function.__module__ == "__main__":
                raise StrategyError(
                    f"{function.__qualname__} is in the program that was started, which another process cannot "
                    "import: put it into a module of its own"
                )
            self._modules.add(function.__module__.partition(".")[0])
        if is_kernel_function and function is not None:
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
