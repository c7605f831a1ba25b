"""What a user's own stages are made of: a rendering is resumed only by the same code."""

from ..errors import StrategyError
from ..stages.registry import StageEntry, find_stage
from ..stages.user_code_digest import file_digests
from .intersection_strategy import IntersectionStrategy


def stage_sources(strategy: IntersectionStrategy) -> dict[str, str]:
    """Digest of each stage that is not the package's own, by name, as it was registered; empty for most strategies.

    It is of the whole file that defines the stage, and what is bound to it: see `digest_of`.
    """
    return {entry.name: entry.digest for entry in _own_entries(strategy)}


def require_unedited(strategy: IntersectionStrategy) -> None:
    """Raise StrategyError for a stage whose file is no longer what was imported: results would go by the new one.

    What a stage holds beside may change as it runs: it counts as it was registered.
    """
    for entry in _own_entries(strategy):
        for file in [file for file, digest in entry.files.items() if file_digests([file]).get(file) != digest]:
            raise StrategyError(
                f"{entry.role} stage {entry.name!r}: {file} has changed since it was imported: start anew"
            )


def has_own_stages(strategy: IntersectionStrategy) -> bool:
    """Whether some stage is a user's own."""
    return bool(_own_entries(strategy))


def _own_entries(strategy: IntersectionStrategy) -> list[StageEntry]:
    entries = [find_stage(role, stage.name) for role, stages in strategy.stages().items() for stage in stages]
    return [entry for entry in entries if not entry.own]
