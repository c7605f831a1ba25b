"""Keys whose values go together row by row instead of as a product: those of `zip`, and those that `[sample]` draws.

`[sample]` replaces each range of `from` and `to` alone by a list of drawn numbers, and ties these lists.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict

from ....datasets.known_names import likely_name
from ...motions.explorations.habits import NUMBER_MOST
from ...validation import value_text
from .axes import KEYS, AxisTable, Tie
from .line_search import Place
from .values import (
    DRAWN,
    ChoiceCheck,
    NumberCheck,
    checked_items,
    logarithmic,
    range_ends,
    refuse,
    rounded,
    within,
)

METHODS = ("sobol", "latin-hypercube", "random")
COUNT_MOST = 2**14
"""Rows of keys that go together; loading a plan takes half a millisecond for each."""
AxisKeyName = tuple[str, str]
"""Axis and key."""
Ties = dict[str, list[dict[str, Tie]]]
"""By axis: the tied keys of each of its tables."""


def read_zip(value: object) -> list[list[AxisKeyName]]:
    """The groups of keys of `zip`; raises PlanFault."""
    if not isinstance(value, list):
        refuse(f'must be a list of lists of keys, such as [["object.source", "motion.seed"]], not {value_text(value)}')
    groups = checked_items(_read_group, value)
    seen: set[AxisKeyName] = set()
    for k, group in enumerate(groups):
        for j, key in enumerate(group):
            if key in seen:
                refuse(f"{'.'.join(key)} is listed before; a key goes together with one list of keys", (k, j))
            seen.add(key)
    return groups


def _read_group(value: object) -> list[AxisKeyName]:
    if not isinstance(value, list) or len(value) < 2:
        refuse(f"must be a list of two keys or more, not {value_text(value)}")
    return checked_items(_read_key, value)


def _read_key(value: object) -> AxisKeyName:
    axis, _, key = value.partition(".") if isinstance(value, str) else ("", "", "")
    if key not in ("source", *KEYS.get(axis, ())):
        known = [f"{name}.{one}" for name, keys in KEYS.items() for one in ("source", *keys)]
        refuse(f"must be a key of an axis, such as motion.seed, not {value_text(value)}{likely_name(value, known)}")
    return axis, key


class SampleTable(BaseModel):
    """The table `[sample]`: how numbers are drawn."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    method: Annotated[str, BeforeValidator(ChoiceCheck(METHODS))]
    count: Annotated[int, BeforeValidator(NumberCheck(1, COUNT_MOST, whole=True))]
    seed: Annotated[int, BeforeValidator(NumberCheck(0, NUMBER_MOST, whole=True))] = 1

    def points(self, dimension_count: int) -> NDArray[np.float64]:
        """Points of the unit cube; shape [count, dimension]. Raises PlanFault for a Sobol count that is no power of 2.

        The first points of a longer Sobol sequence of one seed are those of a shorter one.
        """
        from scipy.stats import qmc  # a second that only plans with [sample] take

        rng = np.random.default_rng(self.seed)
        if self.method == "random":
            return rng.random((self.count, dimension_count))
        generator: dict[str, Any] = {"seed": rng}  # its name until scipy 1.15, and still accepted
        if self.method == "latin-hypercube":
            return qmc.LatinHypercube(dimension_count, **generator).random(self.count)
        if self.count & (self.count - 1):
            lower = 1 << (self.count.bit_length() - 1)
            refuse(
                f"must be a power of two for sobol, not {self.count}: only then are its points evenly spread; "
                f"write {lower} or {2 * lower}",
                ("count",),
            )
        return qmc.Sobol(dimension_count, **generator).random(self.count)


class DrawnRange(NamedTuple):
    """A range of a plan that `[sample]` draws numbers from."""

    place: Place
    table: dict[str, Any]
    """The plan's table that has it."""
    check: NumberCheck

    def numbers(self, shares: Sequence[float]) -> list[float]:
        """Numbers in the range; shares: of the way from `from` to `to`, in 0..1 without 1. Raises PlanFault."""
        first, last, log = range_ends(self.table[str(self.place[-1])], self.check)
        if log:
            drawn = [logarithmic(first, last, share) for share in shares]
        elif self.check.whole:  # each whole number with the same probability
            return [int(first) + int(share * (int(last) - int(first) + 1)) for share in shares]
        else:
            drawn = [rounded(first + share * (last - first)) for share in shares]
        return [min(max(round(n) if self.check.whole else n, first), last) for n in drawn]


def drawn_ranges(tables: Mapping[str, Any]) -> list[DrawnRange]:
    """The plan's ranges that have `from` and `to` alone."""
    return [
        DrawnRange((*place, key), table, check)
        for axis, keys in KEYS.items()
        for place, table in placed_tables(axis, tables.get(axis))
        for key, value in (table.items() if isinstance(table, dict) else ())
        if key in keys and isinstance(check := keys[key].check, NumberCheck)
        if isinstance(value, dict) and set(value) - {"log"} == DRAWN
    ]


def placed_tables(axis: str, given: object) -> Iterator[tuple[Place, Any]]:
    """The tables of an axis as the plan has them, each with its place; an axis that is left out has an empty one."""
    if isinstance(given, list):
        yield from (((axis, k), table) for k, table in enumerate(given))
    else:
        yield (axis,), {} if given is None else given


def ties_of(
    zipped: Sequence[Sequence[AxisKeyName]], drawn: Sequence[DrawnRange], tables: Mapping[str, Sequence[AxisTable]]
) -> Ties:
    """The tied keys of each table.

    zipped: groups of keys; the values of a key are those of all tables of its axis, one table after the other.
    drawn: ranges that have a number for each point of the sample. Raises PlanFault with a place of the plan.
    """
    ties: Ties = {axis: [{} for _ in own] for axis, own in tables.items()}
    for place in (own.place for own in drawn):
        ties[str(place[0])][int(place[1]) if len(place) == 3 else 0][str(place[-1])] = Tie(-1, 0)
    for group, keys in enumerate(zipped):
        with within("zip", group):
            _tie(group, keys, tables, ties)
    return ties


def _tie(group: int, keys: Sequence[AxisKeyName], tables: Mapping[str, Sequence[AxisTable]], ties: Ties) -> None:
    """Tie the keys of one group of `zip`."""
    counts: dict[AxisKeyName, list[int]] = {}
    for j, (axis, key) in enumerate(keys):
        own = [table.get(key) for table in tables[axis]]
        if any(values is None for values in own):
            refuse(f"{axis}.{key} has no values in a table of the plan; list as many as the other keys have", (j,))
        if any(key in tied for tied in ties[axis]):
            refuse(f"{axis}.{key} goes together with the other keys that [sample] draws already", (j,))
        counts[axis, key] = [len(values.listed) for values in own if values is not None]
        for k, tied in enumerate(ties[axis]):
            tied[key] = Tie(group, sum(counts[axis, key][:k]))
        (first, expected), count = next(iter(counts.items())), sum(counts[axis, key])
        if count != sum(expected):
            sentence = f"{axis}.{key} has {count} values, but {'.'.join(first)} has {sum(expected)}"
            refuse(f"{sentence}; keys that go together need equally many", (j,))
        if count > COUNT_MOST:
            refuse(f"{axis}.{key} must have at most {COUNT_MOST} values to go together with others, not {count}", (j,))
        for other, among in counts.items():
            if other[0] == axis and among != counts[axis, key]:
                sentence = f"{axis}.{key} and {'.'.join(other)} must have equally many values in each [[{axis}]]"
                refuse(f"{sentence}, not {counts[axis, key]} and {among}", (j,))
