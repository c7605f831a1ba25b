"""Values of a plan's keys: one value, a list, a range or seeds, each checked; a value listed twice is used once.

| a key's value | stands for |
|---|---|
| `0.08` | one value |
| `[0.08, 0.13]` | these; of a key that is a list itself (palm, at): a list of lists |
| `{ from = 5.0, to = 9.0, count = 5 }` | evenly spaced, both ends included; with `log = true` by equal factors |
| `{ from = 5.0, to = 9.0, step = 0.5 }` | from, from + step, ... up to `to` |
| `{ first = 1, count = 20 }` | whole numbers one after the other |

Ranges are computed in fractions of the decimals as written, so that 0.1 in a range is 0.1 in a list; those with `log`
are rounded to 12 digits.
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NoReturn

from ....datasets.known_names import find_name, likely_name
from ...validation import unit_hint, value_text
from .line_search import Place

QUANTITY = re.compile(r"\s*([+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?)\s*([^\s\d].*?)\s*")
UNITS = {  # what a text with a unit is in SI
    "m": {"um": 1e-6, "µm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0},
    "m/s": {"mm/s": 1e-3, "cm/s": 1e-2, "m/s": 1.0, "km/h": 1 / 3.6},
    "Hz": {"hz": 1.0, "khz": 1e3, "mhz": 1e6},
    "s": {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0},
    "degree": {"deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0},
}
LOG_DIGITS = 12
LINEAR, STEPPED, SEEDS = {"from", "to", "count"}, {"from", "to", "step"}, {"first", "count"}
DRAWN = {"from", "to"}
"""Keys of a range that [sample] draws numbers from."""
SEED_COUNT_MOST = 2**63 - 1
COUNT_MOST = 10**6
"""Of a range, which is kept as a list; seeds are not."""


class PlanFault(ValueError):
    """A value that is refused: the reason, and its place within the value; passes through pydantic."""

    def __init__(self, sentence: str, place: Place = ()) -> None:
        super().__init__(sentence)
        self.sentence, self.place = sentence, place


def refuse(sentence: str, place: Place = ()) -> NoReturn:
    """Raise PlanFault."""
    raise PlanFault(sentence, place)


@contextmanager
def within(*place: str | int) -> Iterator[None]:
    """Put the place of an item before the place of every PlanFault that is raised in it."""
    try:
        yield
    except PlanFault as fault:
        refuse(fault.sentence, (*place, *fault.place))


@dataclass(frozen=True)
class Values:
    """The values that a key stands for."""

    listed: Sequence[Any]
    """As listed, repeated ones too; seeds are a `range` of any length."""
    items: Sequence[Any]
    """Each value once."""
    repeated: tuple[int, ...] = ()
    """Indices, in the plan's list, of values that stand earlier in it."""

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Any]:
        return iter(self.items)

    def mapped(self, change: Callable[[Any], Any]) -> "Values":
        """The same values changed one by one."""
        return replace(self, listed=tuple(map(change, self.listed)), items=tuple(map(change, self.items)))


@dataclass(frozen=True)
class NumberCheck:
    """Checks a number; whole ones may be written as floats (1e6)."""

    low: float
    high: float
    unit: str = ""
    whole: bool = False

    @property
    def span(self) -> str:
        """Its bounds, in a sentence."""
        return f"{self.low:g}..{self.high:g} {self.unit}".rstrip()

    def __call__(self, value: object) -> float:
        """The number, an int if it must be whole."""
        if isinstance(value, str):
            refuse(self._of_text(value))
        if isinstance(value, bool) or not isinstance(value, int | float):
            refuse(f"must be a number in {self.span}, not {value_text(value)}")
        if not self.low <= value <= self.high:  # a NaN compares false
            hint = unit_hint(value, self.low, self.high, self.unit)
            refuse(f"must lie in {self.span}, not {value_text(value)}{hint}")
        if not self.whole:
            return float(value) + 0.0  # no -0.0
        if isinstance(value, float) and not value.is_integer():
            refuse(f"must be a whole number in {self.span}, not {value_text(value)}")
        return int(value)

    def _of_text(self, text: str) -> str:
        """The fault of a number in quotes, with the value to write if its unit is known."""
        sentence = f"must be a number in {self.span}, without quotes, not {text!r}"
        found = QUANTITY.fullmatch(text)
        if not found:
            return sentence
        known = {name.lower(): factor for name, factor in UNITS.get(self.unit, {}).items()}
        factor = known.get(found[2].lower())
        try:
            return sentence if factor is None else f"{sentence}: write {round(float(found[1]) * factor, 15):g}"
        except ValueError:  # "1.2.3 m"
            return sentence


@dataclass(frozen=True)
class VectorCheck:
    """Checks a list of so many numbers."""

    size: int
    number: NumberCheck

    def __call__(self, value: object) -> list[float]:
        """The numbers."""
        if not isinstance(value, list) or len(value) != self.size:
            refuse(f"must be a list of {self.size} numbers in {self.number.span}, not {value_text(value)}")
        return checked_items(self.number, value)


@dataclass(frozen=True)
class LabelCheck:
    """Checks the labels of a segmented volume that are solid: a number, or several."""

    number: NumberCheck

    def __call__(self, value: object) -> list[int]:
        """The labels in order, each once."""
        items = value if isinstance(value, list) else [value]
        if not items:
            refuse("must be at least one label, not []")
        return sorted({int(label) for label in checked_items(self.number, items)})


@dataclass(frozen=True)
class ChoiceCheck:
    """Checks a name."""

    known: tuple[str, ...]

    def __call__(self, value: object) -> str:
        """The name."""
        found = find_name(value, self.known) if isinstance(value, str) else None
        if found is None:
            refuse(f"must be one of {', '.join(self.known)}, not {value_text(value)}{likely_name(value, self.known)}")
        return found


@dataclass(frozen=True)
class TextCheck:
    """Checks a text."""

    def __call__(self, value: object) -> str:
        """The text."""
        if not isinstance(value, str) or not value:
            refuse(f"must be a text, not {value_text(value)}")
        return value


Check = NumberCheck | VectorCheck | LabelCheck | ChoiceCheck | TextCheck


def read_values(value: object, check: Check) -> Values:
    """The values that a value of a plan stands for: itself, those of a list, a range or seeds; raises PlanFault."""
    if isinstance(value, dict):
        if not isinstance(check, NumberCheck):
            refuse(f"cannot be a range, {value_text(value)}: it is no number")
        numbers = _ranged(value, check)
        return Values(numbers, numbers)
    is_list = isinstance(value, list)
    if isinstance(check, VectorCheck | LabelCheck):  # of which one value may be a list
        is_list = isinstance(value, list) and (not value or any(isinstance(item, list) for item in value))
    if is_list and value in ([], [[]]):
        refuse("must have at least one value, not []")
    listed = checked_items(check, value) if is_list and isinstance(value, list) else [check(value)]
    return unique(listed, [repr(item) for item in listed])


def unique(listed: Sequence[Any], identities: Sequence[str]) -> Values:
    """Values of a list, those of one identity once."""
    first: dict[str, int] = {}
    for k, identity in enumerate(identities):
        first.setdefault(identity, k)
    repeated = tuple(k for k, identity in enumerate(identities) if first[identity] != k)
    return Values(tuple(listed), tuple(listed[k] for k in first.values()), repeated)


def checked_items(check: Callable[[Any], Any], items: Sequence[object]) -> list[Any]:
    """The items of a list, each checked."""
    out: list[Any] = []
    for k, item in enumerate(items):
        with within(k):
            out.append(check(item))
    return out


def range_ends(value: dict[str, Any], check: NumberCheck) -> tuple[float, float, bool]:
    """`from`, `to` and `log` of a range."""
    ends: list[float] = []
    for key in ("from", "to"):
        with within(key):
            ends.append(check(value[key]))
    first, last = ends
    if first > last:
        refuse(f"must be at most `to`, {last:g}, not {first:g}", ("from",))
    log = value.get("log", False)
    if not isinstance(log, bool) or (log and "step" in value):
        refuse(f"must be true or false, and goes with from, to and count, not {value_text(log)}", ("log",))
    if log and first <= 0:
        refuse(f"must be above 0 for log, not {first:g}", ("from",))
    return first, last, log


def _ranged(value: dict[str, Any], check: NumberCheck) -> Sequence[float]:
    """The numbers of a range."""
    keys = set(value) - {"log"}
    for key in keys - (LINEAR | STEPPED | SEEDS):
        refuse(f"unknown key {key!r} of a range; known: from, to, count, step, log, first", (key,))
    if keys == SEEDS:
        return _consecutive(value, check)
    if keys not in (LINEAR, STEPPED):
        drawn = "; from and to alone need a table [sample]" if keys == DRAWN else ""
        refuse(
            f"a range is from, to and count, or from, to and step, or first and count, not {value_text(value)}{drawn}"
        )
    first, last, log = range_ends(value, check)
    if "step" in value:
        return _stepped(value["step"], first, last, check)
    count = _count(value, SEED_COUNT_MOST if check.whole and not log else COUNT_MOST)
    if (count == 1) != (first == last):
        refuse(f"count must be {'1' if first == last else '2 or more'} from {first:g} to {last:g}, not {count}")
    if log:
        inner = [logarithmic(first, last, k / (count - 1)) for k in range(1, count - 1)]
        return _different([first, *inner, last][:count], check)
    return _spaced(first, (fraction(last) - fraction(first)) / max(count - 1, 1), count, check)


def _count(value: dict[str, Any], most: int) -> int:
    with within("count"):
        return int(NumberCheck(1, most, whole=True)(value["count"]))


def _consecutive(value: dict[str, Any], check: NumberCheck) -> range:
    """Seeds."""
    if not check.whole:
        refuse(f"first and count are of whole numbers; here from, to and count, or step, not {value_text(value)}")
    if "log" in value:
        refuse("goes with from, to and count", ("log",))
    with within("first"):
        first = int(check(value["first"]))
    count = _count(value, SEED_COUNT_MOST)
    if first + count - 1 > check.high:
        refuse(f"must be at most {check.high:g} with first, not {first + count - 1}", ("count",))
    return range(first, first + count)


def _stepped(value: object, first: float, last: float, check: NumberCheck) -> Sequence[float]:
    with within("step"):
        step = fraction(NumberCheck(0, 1e300, check.unit)(value))
        if step == 0:
            refuse(f"must be above 0, not {value_text(value)}")
        count = (fraction(last) - fraction(first)) // step + 1  # a whole number of any size
        if count > (most := SEED_COUNT_MOST if check.whole else COUNT_MOST):
            refuse(f"must be larger: more than {most:g} numbers are {value_text(value)} apart")
    return _spaced(first, step, count, check)


def _spaced(first: float, step: Fraction, count: int, check: NumberCheck) -> Sequence[float]:
    """Evenly spaced numbers; whole ones must come out whole."""
    if check.whole:
        if step.denominator != 1:
            refuse(f"{count} whole numbers from {first:g} on cannot be {float(step):g} apart")
        return range(int(first), int(first) + count * int(step) if step else int(first) + 1, max(int(step), 1))
    start, common = fraction(first), fraction(first).denominator * step.denominator
    begin, stride = int(start * common), int(step * common)
    return _different([(begin + k * stride) / common for k in range(count)], check)  # int / int is rounded once


def _different(numbers: list[float], check: NumberCheck) -> Sequence[float]:
    """The numbers of a range, refused if two are the same."""
    if len(set(numbers)) < len(numbers):
        first, last = numbers[0], numbers[-1]
        refuse(f"count must be lower: {len(numbers)} numbers from {first:g} to {last:g} are not all different")
    return tuple(int(check(number)) for number in numbers) if check.whole else tuple(numbers)


def fraction(number: float) -> Fraction:
    """The value of a number's shortest decimal."""
    return Fraction(repr(number))


def logarithmic(first: float, last: float, share: float) -> float:
    """A number between two by equal factors, rounded to LOG_DIGITS digits; share: 0 for `first`, 1 for `last`."""
    return rounded(math.exp(math.log(first) * (1 - share) + math.log(last) * share))


def rounded(number: float) -> float:
    """A number of LOG_DIGITS digits."""
    return float(f"{number:.{LOG_DIGITS}g}")
