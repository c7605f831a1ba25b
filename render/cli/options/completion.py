"""Names that a shell completes (`palpate --install-completion`); where none fits, it completes names of files."""

from importlib import import_module
from typing import Any


def _named(module: str, name: str, incomplete: str) -> list[str]:
    """The names in a collection of a module that begin so; the module is imported only when a shell asks."""
    known: Any = getattr(import_module(module, "palpate.render.cli"), name)
    words: list[str] = list(known() if callable(known) else known)
    return [word for word in words if word.startswith(incomplete.casefold())]


def complete_object(incomplete: str) -> list[str]:
    """Built-in objects."""
    return _named("...datasets.shapes.built_in", "shape_names", incomplete)


def complete_motion(incomplete: str) -> list[str]:
    """The word for a synthetic motion."""
    return [word for word in ("exploration",) if word.startswith(incomplete.casefold())]


def complete_strategy(incomplete: str) -> list[str]:
    """Presets of intersection strategies."""
    return _named("..strategies.intersection_strategy", "PRESETS", incomplete)


def complete_hand(incomplete: str) -> list[str]:
    """Kinds of hands."""
    return _named("..intersection.named_inputs", "HANDS", incomplete)


def complete_sampling(incomplete: str) -> list[str]:
    """Presets of sampling strategies."""
    return _named("..sampling.presets", "PRESETS", incomplete)


def complete_array(incomplete: str) -> list[str]:
    """Arrays."""
    return _named("...device.registry", "array_names", incomplete)


def complete_format(incomplete: str) -> list[str]:
    """Formats of `palpate export`."""
    return _named("..exports.file_export", "FORMATS", incomplete)
