"""Values as a plan has them: one, a list, a range or seeds, each checked; units in texts told, duplicates dropped.

| a key's value | stands for |
|---|---|
| `0.08` | one value |
| `[0.08, 0.13]` | these; of a key that is a list itself (palm, at): a list of lists |
| `{ from = 5.0, to = 9.0, count = 5 }` | evenly spaced, both ends included; with `log = true` by equal factors |
| `{ from = 5.0, to = 9.0, step = 0.5 }` | from, from + step, ... up to `to` |
| `{ first = 1, count = 20 }` | whole numbers one after the other |

Ranges are worked out in fractions of the decimals as written, so that 0.1 in a range is 0.1 in a list; those with `log`
are rounded to 12 digits.
"""

import difflib
import math
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NoReturn, overload

from ...validation import value_text
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
COUNT_MOST = 2**63 - 1


class Fault(ValueError):
    """What is wrong with a value, and where within it; pydantic hands it on."""

    def __init__(self, sentence: str, place: Place = ()) -> None:
        super().__init__(sentence)
        self.sentence, self.place = sentence, place


def refuse(sentence: str, place: Place = ()) -> NoReturn:
    """Raise a fault."""
    raise Fault(sentence, place)


def near(name: object, known: Collection[str]) -> str:
    """The known name that is meant, as part of a sentence; empty if none is alike."""
    close = difflib.get_close_matches(str(name).lower(), known, 1, 0.6)
    return f" (did you mean {close[0]!r}?)" if close else ""


@dataclass(frozen=True)
class Values:
    """What a key stands for, each value once."""

    items: Sequence[Any]
    """A range is not spelt out: it may be of any length."""
    repeated: tuple[int, ...] = ()
    """Places in a list of those that were there before."""

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Any]:
        return (self.items[k] for k in range(len(self.items)))


@dataclass(frozen=True)
class Number:
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
            refuse(f"must lie in {self.span}, not {value_text(value)}{self._smaller_unit(value)}")
        if not self.whole:
            return float(value) + 0.0  # no -0.0
        if isinstance(value, float) and not value.is_integer():
            refuse(f"must be a whole number in {self.span}, not {value_text(value)}")
        return int(value)

    def _of_text(self, text: str) -> str:
        """What is wrong with a number in quotes, its unit understood where it can be."""
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

    def _smaller_unit(self, value: float) -> str:
        """What the number would be if it were in millimetres."""
        if self.unit == "m" and 1000 * self.low <= abs(value) <= 1000 * self.high:
            return f": lengths are in metres, {value:g} mm are {value / 1000:g}"
        return ""


@dataclass(frozen=True)
class Vector:
    """Checks a list of so many numbers."""

    size: int
    number: Number

    def __call__(self, value: object) -> list[float]:
        """The numbers."""
        if not isinstance(value, list) or len(value) != self.size:
            refuse(f"must be a list of {self.size} numbers in {self.number.span}, not {value_text(value)}")
        return [_at(k, self.number, item) for k, item in enumerate(value)]


@dataclass(frozen=True)
class Labels:
    """Checks the labels of a segmented volume that are solid: a number, or several."""

    number: Number

    def __call__(self, value: object) -> list[int]:
        """The labels in order, each once."""
        items = value if isinstance(value, list) else [value]
        if not items:
            refuse("must be at least one label, not []")
        return sorted({int(_at(k, self.number, item)) for k, item in enumerate(items)})


@dataclass(frozen=True)
class Choice:
    """Checks a name."""

    known: tuple[str, ...]

    def __call__(self, value: object) -> str:
        """The name."""
        if not isinstance(value, str) or value not in self.known:
            refuse(f"must be one of {', '.join(self.known)}, not {value_text(value)}{near(value, self.known)}")
        return value


@dataclass(frozen=True)
class Text:
    """Checks a text."""

    def __call__(self, value: object) -> str:
        """The text."""
        if not isinstance(value, str) or not value:
            refuse(f"must be a text, not {value_text(value)}")
        return value


Check = Number | Vector | Labels | Choice | Text


def swept(check: Check) -> Callable[[object], Values]:
    """What reads a key's value, or its list, range or seeds; raises faults with the place within the value."""

    def read(value: object) -> Values:
        if isinstance(value, dict):
            if not isinstance(check, Number):
                refuse(f"cannot be a range, {value_text(value)}: it is no number")
            return Values(_ranged(value, check))
        several = isinstance(value, list)
        if isinstance(check, Vector | Labels):
            several = isinstance(value, list) and any(isinstance(item, list) for item in value)
        return listed(value if several and isinstance(value, list) else [value], check, indexed=several or value == [])

    return read


def listed(items: list[Any], check: Callable[[Any], Any], *, indexed: bool = True) -> Values:
    """Values of a list, each once."""
    if not items or (indexed and items == [[]]):
        refuse("must have at least one value, not []")
    kept: list[Any] = []
    repeated: list[int] = []
    seen: set[str] = set()
    for k, item in enumerate(items):
        value = _at(k, check, item) if indexed else check(item)
        known = repr(value)
        repeated.append(k) if known in seen else kept.append(value)
        seen.add(known)
    return Values(tuple(kept), tuple(repeated))


def _at(k: int, check: Callable[[Any], Any], item: object) -> Any:
    """A checked item of a list; its faults tell which it is."""
    try:
        return check(item)
    except Fault as fault:
        refuse(fault.sentence, (k, *fault.place))


def _ranged(value: dict[str, Any], check: Number) -> Sequence[float]:
    """The numbers of a range, not spelt out."""
    keys = set(value) - {"log"}
    for key in keys - (LINEAR | STEPPED | SEEDS):
        refuse(f"unknown key {key!r} of a range; known: from, to, count, step, log, first", (key,))
    if keys not in (LINEAR, STEPPED, SEEDS):
        refuse(f"a range is from, to and count, or from, to and step, or first and count, not {value_text(value)}")
    if keys == SEEDS:
        return _consecutive(value, check)
    first, last = (_at_key(end, check, value[end]) for end in ("from", "to"))
    if first > last:
        refuse(f"must be at most `to`, {last:g}, not {first:g}", ("from",))
    log = value.get("log", False)
    if not isinstance(log, bool) or (log and "step" in value):
        refuse(f"must be true or false, and goes with from, to and count, not {value_text(log)}", ("log",))
    if "step" in value:
        return _stepped(value["step"], first, last, check)
    count = int(_at_key("count", Number(1, COUNT_MOST, whole=True), value["count"]))
    if (count == 1) != (first == last):
        refuse(f"count must be {'1' if first == last else '2 or more'} from {first:g} to {last:g}, not {count}")
    if log:
        if first <= 0:
            refuse(f"must be above 0 for log, not {first:g}", ("from",))
        return _tried(Logarithmic(first, last, count), check)
    return _spaced(first, (fraction(last) - fraction(first)) / max(count - 1, 1), count, check)


def _at_key(key: str, check: Callable[[Any], Any], item: object) -> Any:
    try:
        return check(item)
    except Fault as fault:
        refuse(fault.sentence, (key,))


def _consecutive(value: dict[str, Any], check: Number) -> range:
    """Seeds."""
    if not check.whole:
        refuse(f"first and count are of whole numbers; here from, to and count, or step, not {value_text(value)}")
    if "log" in value:
        refuse("goes with from, to and count", ("log",))
    first = int(_at_key("first", check, value["first"]))
    count = int(_at_key("count", Number(1, COUNT_MOST, whole=True), value["count"]))
    if first + count - 1 > check.high:
        refuse(f"must be at most {check.high:g} with first, not {first + count - 1}", ("count",))
    return range(first, first + count)


def _stepped(value: object, first: float, last: float, check: Number) -> Sequence[float]:
    span = fraction(last) - fraction(first)
    step = fraction(_at_key("step", Number(0, 1e300, check.unit), value))
    if step == 0:
        refuse(f"must be above 0, not {value_text(value)}", ("step",))
    count = span // step + 1  # a whole number of any size
    if count > COUNT_MOST:
        refuse(f"must be larger: more than {COUNT_MOST:g} numbers are {value_text(value)} apart", ("step",))
    return _spaced(first, step, count, check)


def _spaced(first: float, step: Fraction, count: int, check: Number) -> Sequence[float]:
    """Evenly spaced numbers; whole ones must come out whole."""
    if check.whole:
        if step.denominator != 1:
            refuse(f"{count} whole numbers from {first:g} on cannot be {float(step):g} apart")
        return range(int(first), int(first) + count * int(step) if step else int(first) + 1, max(int(step), 1))
    return _tried(Spaced(fraction(first), step, count), check)


def _tried(numbers: "Spaced | Logarithmic", check: Number) -> Sequence[float]:
    """A range whose numbers are all different."""
    count = len(numbers)
    if count > 1 and (numbers[0] == numbers[1] or numbers[count - 2] == numbers[count - 1]):
        refuse(f"count must be lower: {count} numbers from {numbers[0]:g} to {numbers[-1]:g} are not all different")
    return tuple(int(check(number)) for number in numbers) if check.whole else numbers


def fraction(number: float) -> Fraction:
    """A number as its shortest decimal says."""
    return Fraction(repr(number))


class Lazy(Sequence[float]):
    """Numbers, each worked out when it is asked for: a range of a thousand million takes no room."""

    length: int

    def at(self, place: int) -> float:
        """The number at a place from 0."""
        raise NotImplementedError

    def __len__(self) -> int:
        return self.length

    @overload
    def __getitem__(self, index: int) -> float: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[float]: ...
    def __getitem__(self, index: int | slice) -> float | Sequence[float]:
        places = range(self.length)[index]
        return self.at(places) if isinstance(places, int) else tuple(self.at(place) for place in places)


@dataclass(frozen=True)
class Spaced(Lazy):
    """Evenly spaced numbers."""

    first: Fraction
    step: Fraction
    length: int

    def at(self, place: int) -> float:
        """Rounded once."""
        return float(self.first + place * self.step)


@dataclass(frozen=True)
class Logarithmic(Lazy):
    """Numbers by equal factors."""

    first: float
    last: float
    length: int

    def at(self, place: int) -> float:
        """Both ends as they were given, the others to LOG_DIGITS digits."""
        if place in (0, self.length - 1):
            return (self.first, self.last)[place > 0]
        share = place / (self.length - 1)
        exact = math.exp(math.log(self.first) * (1 - share) + math.log(self.last) * share)
        return float(f"{exact:.{LOG_DIGITS}g}")
