"""Sampling strategies as data: the motion of focal points along contours, and modulations of it.

Terms follow Mulot et al. 2021 (DOLPHIN) and Frier et al. 2019; each group of parameters is a dataclass.

| group | meaning | default |
|---|---|---|
| `speed`, `update_rate` | how fast a focal point runs; how often it is moved | 7 m/s, 10 kHz |
| `hold`, `fade` | what happens when the next pose is missing | 0.1 s, then 0.02 s |
| `pace` | what stays constant: speed, draw frequency, or speed within a band of frequencies; points a cycle | speed |
| `order` | in which order a cycle's points come, and the contours of a pose | loop, shortest jumps |
| `gap` | how the focal point gets from one polyline to the next | jump |
| `dwell` | pauses at corners | none |
| `am`, `lm` | amplitude modulation; lateral modulation, a small circle | none |
| `sections` | the contour is divided into sections, each drawn many times before the next | none |
| `foci` | focal points that run along the contours at once | 1 |
| `continuity` | where drawing goes on when a new pose has other contours | nearest |
"""

import json
import math
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from ..errors import StrategyError
from ..validation import known_fields, read_fields, require_choice, require_number

JUMP_LENGTH = 5e-3  # [m] a step this long is a jump at any speed
SEAM = 1e-3  # of a sample; a cycle longer by less gets no further sample: float32 noise of contours is that large


@dataclass(frozen=True)
class Pace:
    """Duration of a cycle.

    | kind | constant | draw frequency of contours of length L | samples a cycle |
    |---|---|---|---|
    | speed | speed v | v / L | rounded up: never faster than v |
    | frequency | draw frequency f | f, whatever the length; the speed is f L | rounded |
    | capped | speed v where it can be | v / L, but at least `lowest` and at most `highest` | rounded, within the band |
    | still | the position on the contour | 0 | 1 |

    A frequency scales the whole cycle: pauses and fast returns too. The default band: MAMMOTH (Maunsbach et al. 2024).
    """

    kind: str = "speed"
    frequency: float = 70.0  # draw frequency of kind "frequency" [Hz]
    lowest: float = 60.0
    """Lowest draw frequency of kind "capped" [Hz]."""
    highest: float = 200.0
    """Highest draw frequency of kind "capped" [Hz]."""
    points: int | None = None
    """Points a cycle, equally spaced in time, each shown for several updates; None: one an update. Frier et al.
    2019 found that it should be tuned separately from the update rate."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_choice("pace.kind", self.kind, ("speed", "frequency", "capped", "still"))
        for name in ("frequency", "lowest", "highest"):
            require_number(f"pace.{name}", getattr(self, name), 1e-3, 10_000.0, unit="Hz")
        if self.lowest > self.highest:
            raise StrategyError(f"pace.lowest must be at most pace.highest, {self.highest:g} Hz, not {self.lowest:g}")
        if self.points is not None:
            require_number("pace.points", self.points, 1, 1_000_000, whole=True)

    def samples_within(self, update_rate: float) -> tuple[int, int]:
        """Fewest and most samples a cycle whose draw frequency lies within `lowest`..`highest`; update_rate: [Hz]."""
        return math.ceil(update_rate / self.highest - 1e-9), math.floor(update_rate / self.lowest + 1e-9)


@dataclass(frozen=True)
class Order:
    """Order in which the points of a cycle are drawn.

    | kind | a cycle | source |
    |---|---|---|
    | loop | all polylines, one after the other, and again | |
    | pendulum | there and back | no jump on one open contour |
    | step | `pace.points` points in the order 0, k, 2k ... modulo their number, prime to k | DOLPHIN |
    | random | `pace.points` points in a random order, the same in every cycle | DOLPHIN |

    In "step" and "random" a cycle takes at least as many updates as points, so that every point is shown.
    """

    kind: str = "loop"
    step: int = 1  # k of kind "step"
    seed: int = 0  # of kind "random"
    route: str = "shortest"
    """Order of several polylines: "shortest" minimises the jumps between them (loops may start anywhere, open pieces
    run in either direction), "given" keeps the batch's order, starts and directions."""
    margin: float = 0.2
    """Hysteresis against frequent changes of the route (the order of polylines). A new shortest route is searched only
    when the total jump length exceeds, by this share plus 5 mm, its smallest value since the last search; it is taken
    only if it is shorter by as much. For a change may delay a polyline by up to one cycle, but jumps take no time."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_choice("order.kind", self.kind, ("loop", "pendulum", "step", "random"))
        require_number("order.step", self.step, 1, 1_000_000, whole=True)
        require_number("order.seed", self.seed, 0, 2**63 - 1, whole=True)
        require_choice("order.route", self.route, ("shortest", "given"))
        require_number("order.margin", self.margin, 0, 1000)


@dataclass(frozen=True)
class Gap:
    """Way of the focal point from the end of a polyline to the start of the next, and from the last to the first.

    | kind | does |
    |---|---|
    | jump | goes there from one sample to the next |
    | return | runs straight at `speed` with unchanged intensity |
    | pendulum | draws open pieces there and back, then jumps |
    | close | closes open pieces by their chord, drawn like the rest, then jumps |

    >>> from palpate.render import Gap, SamplingStrategy, render, static_pose
    >>> line = render("cube", "palm", static_pose([0.05, 0, 0.2]), "oc")  # across the palm: 85 mm, drawn in 12 ms
    >>> ways = [SamplingStrategy(gap=Gap(kind)) for kind in ("jump", "pendulum")]
    >>> [sum(line.sample(way, duration=0.1).count.jumps.values()) for way in ways]
    [8, 0]
    """

    kind: str = "jump"
    speed: float = 14.0
    """Speed of kind "return" [m/s]; in simulation 14 was quieter than a jump, 60 louder."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_choice("gap.kind", self.kind, ("jump", "return", "pendulum", "close"))
        require_number("gap.speed", self.speed, 1e-3, 200.0, unit="m/s")


@dataclass(frozen=True)
class Dwell:
    """Pauses at corners and at the ends of open polylines, not along smooth arcs.

    Only one of `time` and `share` may be above 0.

    >>> from palpate.render import Dwell, SamplingStrategy, render, static_pose
    >>> square = render("cube", "palm", static_pose([0, 0, 0.2]), "cc")  # drawn in 49 ms, with four pauses in 89 ms
    >>> ways = [SamplingStrategy(dwell=Dwell(time)) for time in (0.0, 0.01)]
    >>> [round(square.sample(way, duration=0.1).draw_frequency, 1) for way in ways]
    [20.6, 11.3]
    """

    time: float = 0.0
    """Duration of each pause [s]."""
    share: float = 0.0
    """Share of the cycle that all pauses take together, 0..0.99."""
    angle: float = math.pi / 6
    """A corner turns by more than this [rad]."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_number("dwell.time", self.time, 0, 10, unit="s")
        require_number("dwell.share", self.share, 0, 0.99)
        require_number("dwell.angle", self.angle, 0, math.pi)
        if self.time > 0 and self.share > 0:
            raise StrategyError(f"dwell.time must be 0 where dwell.share is {self.share:g}, not {self.time:g} s")


@dataclass(frozen=True)
class AmplitudeModulation:
    """Multiplies the intensity by a wave between 1 - depth and 1, lowest at time 0."""

    frequency: float = 200.0  # [Hz]; Pacinian corpuscles are most sensitive at 200..250
    depth: float = 1.0
    wave: str = "sine"  # or "square"

    def __post_init__(self) -> None:
        """Check every field."""
        require_number("am.frequency", self.frequency, 1e-3, 20_000.0, unit="Hz")
        require_number("am.depth", self.depth, 0, 1)
        require_choice("am.wave", self.wave, ("sine", "square"))


@dataclass(frozen=True)
class LateralModulation:
    """A small circle around each focal point, in the plane of the palm (hand frame: from +X towards -Z)."""

    radius: float = 0.003  # [m]
    frequency: float = 200.0  # turns a second [Hz]

    def __post_init__(self) -> None:
        """Check every field."""
        require_number("lm.radius", self.radius, 0, 0.05, unit="m")
        require_number("lm.frequency", self.frequency, 1e-3, 20_000.0, unit="Hz")


@dataclass(frozen=True)
class Sections:
    """Contours divided into sections of equal length, drawn one after the other, each back and forth many times.

    Sections share the cycle (`pace.frequency`); those with a corner together get `dwell.share` of it.
    A section is passed an odd number of times, so that drawing ends where the next section begins.
    """

    count: int = 24
    speed: float = 2.0  # within a section [m/s], rounded so that passes are whole

    def __post_init__(self) -> None:
        """Check every field."""
        require_number("sections.count", self.count, 2, 1000, whole=True)
        require_number("sections.speed", self.speed, 1e-3, 100.0, unit="m/s")


@dataclass(frozen=True)
class SamplingStrategy:
    """Conversion of contours to focal points; by default spatio-temporal modulation at constant speed.

    Raises StrategyError for groups that exclude each other, and for a value out of range, with field, value and bound.

    >>> from palpate.render import SamplingStrategy
    >>> SamplingStrategy(speed=7.0, update_rate=20_000.0).samples_a_cycle(0.35)  # a contour of 0.35 m takes 50 ms
    1000
    """

    speed: float = 7.0
    """Speed of a focal point along the contours [m/s]."""
    update_rate: float = 10_000.0
    """Focal points a second [Hz]: the array's carrier / n."""
    hold: float = 0.1
    """Time for which a pose is drawn while the next one is missing [s]; at least twice the poses' median interval."""
    fade: float = 0.02
    """Time in which the intensity then falls to 0 [s]; the focal point keeps moving."""
    pace: Pace = field(default_factory=Pace)
    order: Order = field(default_factory=Order)
    gap: Gap = field(default_factory=Gap)
    dwell: Dwell = field(default_factory=Dwell)
    am: AmplitudeModulation | None = None
    lm: LateralModulation | None = None
    sections: Sections | None = None
    foci: int = 1
    """Focal points at once, equally spaced in time along the cycle."""
    continuity: str = "nearest"
    """Continuation when a new pose has another number of polylines: at the nearest point at once ("nearest"), or at the
    start of the new contours ("jump")."""

    def __post_init__(self) -> None:
        """Check every field and their combination."""
        for name, low, high, unit in (
            ("speed", 1e-3, 100.0, "m/s"),
            ("update_rate", 1.0, 40_000.0, "Hz"),
            ("hold", 0, 60, "s"),
            ("fade", 0, 60, "s"),
        ):
            require_number(name, getattr(self, name), low, high, unit=unit)
        for name, kind in GROUPS.items():
            value = getattr(self, name)
            if not (isinstance(value, kind) or (value is None and name in OPTIONAL)):
                raise StrategyError(f"{name} must be a {kind.__name__}, not {value!r}")
        require_number("foci", self.foci, 1, 64, whole=True)
        require_choice("continuity", self.continuity, ("nearest", "jump"))
        self._require_agreement()

    def __repr__(self) -> str:
        """One line: speed [m/s], update rate [Hz], and fields that have not their default."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        shown = [n for n, value in own.items() if n in ("speed", "update_rate") or value != getattr(DEFAULT, n)]
        return f"SamplingStrategy({', '.join(f'{name}={own[name]!r}' for name in shown)})"

    def _require_agreement(self) -> None:
        """Raise StrategyError for groups that exclude each other."""
        pace, order = self.pace, self.order
        if order.kind in ("step", "random") and pace.points is None:
            raise StrategyError(f"pace.points must be given for order.kind {order.kind!r}, not None")
        if order.kind == "step" and math.gcd(order.step, pace.points or 1) != 1:
            raise StrategyError(
                f"order.step must share no factor with pace.points {pace.points}, else points are left out, not "
                f"{order.step}"
            )
        fewest, most = pace.samples_within(self.update_rate)
        if pace.kind == "capped" and fewest > most:
            raise StrategyError(
                f"pace.lowest..highest, {pace.lowest:g}..{pace.highest:g} Hz, holds no draw frequency of a whole "
                f"number of samples a cycle at update_rate {self.update_rate:g} Hz"
            )
        if pace.kind == "still" and (order.kind != "loop" or pace.points is not None):
            raise StrategyError(
                f"pace.kind 'still' needs order.kind 'loop' and no pace.points, not {order.kind!r} and {pace.points}"
            )
        if self.dwell.time > 0 and pace.kind == "frequency":
            raise StrategyError(
                f"dwell.time must be 0 for pace.kind 'frequency' (use share), not {self.dwell.time:g} s"
            )
        for name, overlay in (("am", self.am), ("lm", self.lm)):
            if overlay is not None and overlay.frequency > self.update_rate / 2:
                raise StrategyError(
                    f"{name}.frequency must be at most half of update_rate {self.update_rate:g} Hz, not "
                    f"{overlay.frequency:g} Hz"
                )
        if self.sections is not None and (pace.kind != "frequency" or order.kind != "loop" or pace.points is not None):
            raise StrategyError(
                "sections need pace.kind 'frequency', order.kind 'loop' and no pace.points, not "
                f"{pace.kind!r}, {order.kind!r} and {pace.points}"
            )

    @property
    def step(self) -> float:
        """Nominal distance between two samples at `speed` [m]."""
        return self.speed / self.update_rate

    @property
    def jump_threshold(self) -> float:
        """Longest step that is not a jump [m]: max(2 v / f_s, 5 mm); v: speed, or that of a fast return if larger."""
        return max(2.0 * self._fastest / self.update_rate, JUMP_LENGTH)

    @property
    def step_ordinary(self) -> float:
        """Longest step along a contour at the nominal speeds, fast returns and small circles included [m].

        A step longer than twice this is a hop, or a jump above `jump_threshold`. For pace.kind "frequency" and "capped"
        the speed depends on the contours: see `PoseCycle.ordinary`.
        """
        return self._fastest / self.update_rate + self.circle_step

    @property
    def circle_step(self) -> float:
        """Most that lateral modulation adds to a step [m]."""
        return 0.0 if self.lm is None else 2 * math.pi * self.lm.radius * self.lm.frequency / self.update_rate

    @property
    def _fastest(self) -> float:
        """Largest nominal speed, fast returns included [m/s]."""
        return max(self.speed, self.gap.speed) if self.gap.kind == "return" else self.speed

    @property
    def plain(self) -> bool:
        """Whether the duration of a cycle depends on arc length alone: no pauses, returns or sections."""
        return (
            self.order.kind != "pendulum"
            and self.gap.kind == "jump"
            and self.dwell.time == 0
            and self.dwell.share == 0
            and self.sections is None
        )

    def draw_frequency(self, length: np.ndarray) -> np.ndarray:
        """Nominal draw frequency of contours of these lengths [m], pauses left out [Hz]; NaN without contour."""
        length = np.asarray(length, np.float64)
        by_speed = np.divide(self.speed, length, out=np.full(length.shape, np.nan), where=length > 0)
        if self.pace.kind == "speed":
            return by_speed
        if self.pace.kind == "capped":
            return np.clip(by_speed, self.pace.lowest, self.pace.highest)
        return np.where(length > 0, self.pace.frequency if self.pace.kind == "frequency" else 0.0, np.nan)

    @property
    def samples_bounds(self) -> tuple[float, float]:
        """Fewest and most samples of a cycle, whatever it takes."""
        pace, low, high = self.pace, 1.0, math.inf
        if pace.kind == "still":
            high = 1.0
        elif pace.kind == "frequency":
            low = high = float(max(round(self.update_rate / pace.frequency), 1))
        elif pace.kind == "capped":
            low, high = map(float, pace.samples_within(self.update_rate))
        points = float(pace.points or 1) if self.order.kind in ("step", "random") else 1.0
        return max(low, points), max(high, points)

    def samples_of(self, seconds: float) -> int:
        """Number of samples of a cycle that takes `seconds` at the nominal speeds; see `Pace`."""
        low, high = self.samples_bounds
        return int(min(max(math.ceil(seconds * self.update_rate - SEAM), low), high))

    def samples_a_cycle(self, length: float) -> int:
        """Samples per cycle for a length of contours [m], no pauses or returns: ceil(f_s L / v) at constant speed."""
        return self.samples_of(length / self.speed)

    def described(self) -> dict[str, Any]:
        """Every field, for JSON."""
        return asdict(self)

    def to_json(self) -> str:
        """One line of JSON that `from_json` reads back."""
        return json.dumps(self.described())

    @classmethod
    def from_json(cls, text: str) -> "SamplingStrategy":
        """Read back what `to_json` wrote; missing fields take their defaults. Raises StrategyError for a text that is
        not JSON, for unknown fields and for values out of range."""
        values = read_fields(text, [f.name for f in fields(cls)], "sampling")
        for name, kind in GROUPS.items():
            if values.get(name) is not None:
                values[name] = kind(**known_fields(values[name], [f.name for f in fields(kind)], name))
        return cls(**values)


GROUPS: dict[str, Any] = {
    "pace": Pace,
    "order": Order,
    "gap": Gap,
    "dwell": Dwell,
    "am": AmplitudeModulation,
    "lm": LateralModulation,
    "sections": Sections,
}
OPTIONAL = ("am", "lm", "sections")
DEFAULT = SamplingStrategy()
