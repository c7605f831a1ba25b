"""Intersection strategies: raw intersection -> pruning -> transformation, as data (Mulot et al. 2024, section 3)."""

import json
from dataclasses import dataclass

import warp as wp

from ..kernels.close import join_pieces
from ..kernels.draw import draw_contours
from ..kernels.find import find_pieces
from .contours import ContourBatch
from .errors import StrategyError
from .fields import load_by_name, read_fields
from .hands import Palm
from .objects import MeshObject

RAW_STAGES = {"section": "curves in which the object's surface meets the planes of the hand's patches"}
PRUNE_STAGES = {"outside": "remove what lies outside the patch or on its sides"}
TRANSFORM_STAGES = {"close": "add the patch's own boundary where it lies inside the object"}


@dataclass(frozen=True)
class IntersectionStrategy:
    """A raw intersection and the stages that follow it, by name.

    A strategy without pruning gives the whole section of the plane; "close" needs "outside" before it.
    Raises StrategyError for an unknown stage or an order that means nothing.
    """

    raw: str = "section"
    prune: tuple[str, ...] = ()
    transform: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check every stage by name."""
        object.__setattr__(self, "prune", tuple(self.prune))
        object.__setattr__(self, "transform", tuple(self.transform))
        for field, names, known in (
            ("raw", (self.raw,), RAW_STAGES),
            ("prune", self.prune, PRUNE_STAGES),
            ("transform", self.transform, TRANSFORM_STAGES),
        ):
            for name in names:
                if name not in known:
                    raise StrategyError(f"{field}: unknown stage {name!r}; known: {', '.join(known)}")
            if len(set(names)) != len(names):
                raise StrategyError(f"{field}: a stage is listed twice in {list(names)}")
        if "close" in self.transform and "outside" not in self.prune:
            raise StrategyError('transform: "close" needs "outside" in prune, since it closes what the patch cuts open')

    @property
    def needs_closed(self) -> bool:
        """Whether inside and outside of the object must be defined."""
        return "close" in self.transform

    def described(self) -> dict:
        """What a file says about the strategy, for JSON."""
        return {"raw": self.raw, "prune": list(self.prune), "transform": list(self.transform)}

    def to_json(self) -> str:
        """One line of JSON that `from_json` reads back."""
        return json.dumps(self.described())

    @classmethod
    def from_json(cls, text: str) -> "IntersectionStrategy":
        """Read back what `to_json` wrote; missing fields take their defaults."""
        values = read_fields(text, ("raw", "prune", "transform"), "strategy")
        for field in ("prune", "transform"):
            stages = values.get(field, [])
            if not isinstance(stages, list) or not all(isinstance(stage, str) for stage in stages):
                raise StrategyError(f"strategy: {field} must be a list of stage names, not {stages!r}")
        return cls(values.get("raw", "section"), tuple(values.get("prune", ())), tuple(values.get("transform", ())))


def open_contour() -> IntersectionStrategy:
    """OC: what of the section lies inside the patch (strategy A of Martinez et al. 2019)."""
    return IntersectionStrategy(prune=("outside",))


def closed_contour() -> IntersectionStrategy:
    """CC: the boundary of section ∩ patch; holds OC as its object-kind segments."""
    return IntersectionStrategy(prune=("outside",), transform=("close",))


PRESETS = {"oc": open_contour, "cc": closed_contour}


def load_strategy(source: str) -> IntersectionStrategy:
    """A strategy by preset name (oc, cc) or from a JSON file."""
    return load_by_name(source, PRESETS, IntersectionStrategy.from_json, "strategy")


def intersect(
    thing: MeshObject,
    hand: Palm,
    pose: wp.array,
    strategy: IntersectionStrategy,
    *,
    point_limit: int | None = None,
    method: str | None = None,
    timing: dict[str, float] | None = None,
) -> tuple[ContourBatch, int]:
    """Contours of one batch of poses in one go, on the device of the poses, and how many points they have.

    pose: wp.transform, hand frame -> array frame, shape [pose].
    point_limit: more points than this raise `PointLimitError` before memory is taken for them.
    method: how contours are looked for, see `find_pieces`; the result is the same.
    timing: takes the seconds of each stage, which are then waited for one by one.
    """
    if strategy.needs_closed:
        thing.require_closed()
    device = str(pose.device)
    surface, patch = thing.on(device), hand.on(device)
    bounded, closes = "outside" in strategy.prune, "close" in strategy.transform
    with StageClock(timing, "find", device):
        found = find_pieces(surface, pose, patch, bounded=bounded, closes=closes, method=method)
    with StageClock(timing, "join", device):
        joined = join_pieces(surface, found, pose, patch, closes=closes, limit=point_limit)
    with StageClock(timing, "draw", device):
        contours = draw_contours(surface, pose, patch, joined, bounded=bounded, closes=closes)
    return ContourBatch.from_device(contours, hand.patch_count), joined.point_count


class StageClock:
    """Adds the seconds of a stage to `timing`, or does nothing if that is None."""

    def __init__(self, timing: dict[str, float] | None, stage: str, device: str) -> None:
        self._timing, self._stage, self._device = timing, stage, device
        self._timer = wp.ScopedTimer(stage, active=False)

    def __enter__(self) -> None:
        """Start."""
        if self._timing is not None:
            self._timer = wp.ScopedTimer(self._stage, print=False, synchronize=True)
            self._timer.__enter__()

    def __exit__(self, *raised: object) -> None:
        """Stop and add."""
        if self._timing is not None:
            self._timer.__exit__(*raised)
            self._timing[self._stage] = self._timing.get(self._stage, 0.0) + self._timer.elapsed / 1e3
