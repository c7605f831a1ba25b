"""Sampling strategies by name, with the literature's numbers.

| preset | numbers from |
|---|---|
| stm | Frier et al. 2018, 2019; Mulot et al. 2024 |
| constant-frequency | what 7 m/s gives on a contour of 0.1 m |
| capped | MAMMOTH (Maunsbach et al. 2024): 0.35 mm every 25 us |
| pendulum, fast-return | quieter than a jump by 10 and 9 dB in simulation |
| dtp | Hajas et al. 2020; pauses as STP's |
| stp | Mulot et al. 2023; 24 sections are ours |
| lm | lateral modulation, Takahashi et al.; radius ours |
| pressure | arXiv 2301.11572, with 4 foci |
| multi-focus | Shen et al. 2023: weaker than one focus |
| am-multi-focus | Long et al. 2014; the number is ours |
| step, random | DOLPHIN (Mulot et al. 2021); the numbers are ours |
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ...datasets.known_names import find_name, likely_name, unknown_name
from ..errors import StrategyError
from ..validation import load_by_name, read_fields, value_text
from .strategy import (
    AmplitudeModulation,
    Dwell,
    Gap,
    LateralModulation,
    Order,
    Pace,
    SamplingStrategy,
    Sections,
)

SLOW = Pace(kind="frequency", frequency=0.5)
STILL = Pace(kind="still")

PRESETS: dict[str, Callable[[], SamplingStrategy]] = {
    "stm": SamplingStrategy,
    "constant-frequency": lambda: SamplingStrategy(pace=Pace(kind="frequency", frequency=70.0)),
    "capped": lambda: SamplingStrategy(speed=14.0, pace=Pace(kind="capped", lowest=60.0, highest=200.0)),
    "pendulum": lambda: SamplingStrategy(gap=Gap(kind="pendulum")),
    "fast-return": lambda: SamplingStrategy(gap=Gap(kind="return", speed=14.0)),
    "dtp": lambda: SamplingStrategy(pace=SLOW, dwell=Dwell(share=0.8), am=AmplitudeModulation()),
    "stp": lambda: SamplingStrategy(speed=2.0, pace=SLOW, dwell=Dwell(share=0.8), sections=Sections()),
    "am": lambda: SamplingStrategy(pace=STILL, am=AmplitudeModulation()),
    "lm": lambda: SamplingStrategy(pace=STILL, lm=LateralModulation()),
    "pressure": lambda: SamplingStrategy(pace=STILL, lm=LateralModulation(frequency=5.0)),
    "multi-focus": lambda: SamplingStrategy(foci=2),
    "am-multi-focus": lambda: SamplingStrategy(pace=STILL, am=AmplitudeModulation(), foci=8),
    "step": lambda: SamplingStrategy(pace=Pace(points=40), order=Order(kind="step", step=3)),
    "random": lambda: SamplingStrategy(pace=Pace(points=40), order=Order(kind="random")),
}

OTHERS = "; how contours are made, such as cc, is the strategy that render takes"
LINES = {
    "stm": "one focal point at 7 m/s, round and round",
    "constant-frequency": "one focal point at 70 Hz, whatever the length",
    "capped": "one focal point at 14 m/s within 60..200 Hz",
    "pendulum": "open contours there and back: no jump",
    "fast-return": "back to the start of an open contour at 14 m/s",
    "dtp": "a slow point, modulated at 200 Hz, that pauses at corners",
    "stp": "24 sections one after the other at 2 m/s, 80 % of the time at corners",
    "am": "one still point modulated at 200 Hz",
    "lm": "one still point that circles at 200 Hz, radius 3 mm",
    "pressure": "one still point that circles at 5 Hz, radius 3 mm: felt as pressure",
    "multi-focus": "two focal points on the same loop, each at 7 m/s",
    "am-multi-focus": "eight still points along the contours, modulated at 200 Hz",
    "step": "40 points a cycle, every third next",
    "random": "40 points a cycle in random order",
}
"""Description of each preset."""


def preset(name: str, **changes: object) -> SamplingStrategy:
    """A sampling strategy by name, with other fields changed, such as `update_rate`.

    Raises StrategyError for an unknown name and for changes that are no strategy.

    >>> from palpate.render import preset
    >>> preset("multi-focus", update_rate=20_000.0)  # shows speed, rate and what differs from "stm"
    SamplingStrategy(speed=7.0, update_rate=20000.0, foci=2)
    """
    found = find_name(name, PRESETS)
    if found is None:
        raise StrategyError(unknown_name("sampling preset", name, PRESETS))
    try:
        return replace(PRESETS[found](), **changes)
    except TypeError as error:
        known = SamplingStrategy.__dataclass_fields__
        unknown = next(name for name in changes if name not in known)
        meant = likely_name(unknown, known)
        raise StrategyError(f"sampling has no field {unknown!r}{meant}; known: {', '.join(known)}") from error


def load_sampling(source: str) -> SamplingStrategy:
    """A sampling strategy by preset name or from a JSON file.

    >>> from pathlib import Path
    >>> from palpate.render import load_sampling
    >>> _ = Path("slow.json").write_text('{"speed": 5.0}')
    >>> load_sampling("slow.json"), load_sampling("multi-focus")
    (SamplingStrategy(speed=5.0, update_rate=10000.0), SamplingStrategy(speed=7.0, update_rate=10000.0, foci=2))
    """
    return load_by_name(source, PRESETS, SamplingStrategy.from_json, "sampling", others=OTHERS)


def sampling_of(sampling: SamplingStrategy | str | Path) -> SamplingStrategy:
    """The strategy itself, or the one that `load_sampling` gives for a name or file."""
    found = load_sampling(str(sampling)) if isinstance(sampling, str | Path) else sampling
    if not isinstance(found, SamplingStrategy):
        raise StrategyError(f"sampling must be a SamplingStrategy, or the name or file of one, not {value_text(found)}")
    return found


def sets_rate(source: str) -> bool:
    """Whether a strategy that `load_sampling` takes has an update rate of its own: a file that names one."""
    silent = dict.fromkeys(PRESETS, lambda: False)
    fields = SamplingStrategy.__dataclass_fields__
    return load_by_name(
        source, silent, lambda text: "update_rate" in read_fields(text, fields, "sampling"), "sampling", others=OTHERS
    )
