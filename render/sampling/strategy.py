"""Sampling strategies as data: how focal points run along contours, and what is laid over that motion.

The words are those of Mulot et al. 2021 (DOLPHIN) and Frier et al. 2019; each group of parameters is a small dataclass.

| group | says | default |
|---|---|---|
| `speed`, `update_rate` | how fast a focal point runs; how often it is moved | 7 m/s, 10 kHz |
| `hold`, `fade` | what happens when the next pose is missing | 0.1 s, then 0.02 s |
| `pace` | what is kept: speed, draw frequency, or speed within a band of draw frequencies; points a cycle | speed |
| `order` | in which order a cycle's points come, and the contours of a pose | loop, shortest jumps |
| `gap` | how the focal point gets from one polyline to the next | jump |
| `dwell` | pauses at corners | none |
| `am`, `lm` | what is laid over it: intensity, a small circle | none |
| `sections` | the contour cut in sections, each drawn again and again before the next | none |
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
SEAM = 1e-3  # of a sample: by so much a cycle may be longer than its samples, which is float32's noise in contours


@dataclass(frozen=True)
class Pace:
    """How long a cycle takes.

    | kind | kept | draw frequency of contours of length L | samples a cycle |
    |---|---|---|---|
    | speed | speed v | v / L | rounded up: never faster than v |
    | frequency | draw frequency f | f, whatever the length; the speed is f L | rounded |
    | capped | speed v where it can be | v / L, but at least `lowest` and at most `highest` | rounded, within the band |
    | still | the place on the contour | 0 | 1 |

    A frequency scales the whole cycle: pauses and fast returns too. The default band is that of MAMMOTH (Maunsbach et
    al. 2024).
    """

    kind: str = "speed"
    frequency: float = 70.0
    """Draw frequency of kind "frequency" [Hz]."""
    lowest: float = 60.0
    """Draw frequency of kind "capped" [Hz]."""
    highest: float = 200.0
    """The same [Hz]."""
    points: int | None = None
    """Points a cycle, equally spaced in time, each shown for several updates; None: one an update.

    Frier et al. 2019 found that this and the update rate are to be tuned apart.
    """

    def __post_init__(self) -> None:
        """Check every field."""
        require_choice("pace.kind", self.kind, ("speed", "frequency", "capped", "still"))
        for name in ("frequency", "lowest", "highest"):
            require_number(f"pace.{name}", getattr(self, name), 1e-3, 10_000.0)
        if self.lowest > self.highest:
            raise StrategyError(f"pace.lowest must be at most pace.highest, {self.highest:g} Hz, not {self.lowest:g}")
        if self.points is not None:
            require_number("pace.points", self.points, 1, 1_000_000, whole=True)

    def samples_within(self, update_rate: float) -> tuple[int, int]:
        """Fewest and most samples a cycle whose draw frequency lies within `lowest`..`highest`; update_rate: [Hz]."""
        return math.ceil(update_rate / self.highest - 1e-9), math.floor(update_rate / self.lowest + 1e-9)


@dataclass(frozen=True)
class Order:
    """In which order a cycle is drawn.

    | kind | a cycle | source |
    |---|---|---|
    | loop | all polylines, one after the other, and again | |
    | pendulum | there and back | no jump on one open contour |
    | step | `pace.points` points in the order 0, k, 2k ... modulo their number, prime to k | DOLPHIN |
    | random | `pace.points` points in a random order, the same in every cycle | DOLPHIN |

    Contours that need fewer updates a cycle than there are points take as many updates as points in "step" and
    "random": none is left out.
    """

    kind: str = "loop"
    step: int = 1
    """k of kind "step"."""
    seed: int = 0
    """Of kind "random"."""
    route: str = "shortest"
    """Of several polylines: "shortest" jumps between them (loops start anywhere, open pieces run either way), or
    "given": the batch's own order, starts and directions."""
    margin: float = 0.2
    """A pose keeps the route of the pose before until its jumps are longer, by this share and 5 mm, than they were when
    the shortest route was looked for last, or ever since. Then it is looked for, and taken if the jumps are longer than
    its own by as much. A shorter route that has become possible meanwhile is no reason to look. A change of the route
    costs up to one more cycle until a polyline is drawn again, whereas longer jumps take no time."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_choice("order.kind", self.kind, ("loop", "pendulum", "step", "random"))
        require_number("order.step", self.step, 1, 1_000_000, whole=True)
        require_number("order.seed", self.seed, 0, 2**63 - 1, whole=True)
        require_choice("order.route", self.route, ("shortest", "given"))
        require_number("order.margin", self.margin, 0, 1000)


@dataclass(frozen=True)
class Gap:
    """How the focal point gets from the end of a polyline to the start of the next, and from the last to the first.

    | kind | does |
    |---|---|
    | jump | nothing in between: from one sample to the next |
    | return | runs straight at `speed`, intensity kept |
    | pendulum | draws open pieces there and back, then jumps |
    | close | closes open pieces by their chord, drawn like the rest, then jumps |
    """

    kind: str = "jump"
    speed: float = 14.0
    """Of kind "return" [m/s]; 14 was quieter than a jump in simulation, 60 louder."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_choice("gap.kind", self.kind, ("jump", "return", "pendulum", "close"))
        require_number("gap.speed", self.speed, 1e-3, 200.0)


@dataclass(frozen=True)
class Dwell:
    """Pauses at corners, and at the ends of open pieces; none along smooth arcs.

    Either `time` or `share` is given.
    """

    time: float = 0.0
    """Of each pause [s]."""
    share: float = 0.0
    """Of the cycle that all pauses take together, 0..0.99."""
    angle: float = math.pi / 6
    """A corner turns by more than this [rad]."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_number("dwell.time", self.time, 0, 10)
        require_number("dwell.share", self.share, 0, 0.99)
        require_number("dwell.angle", self.angle, 0, math.pi)
        if self.time > 0 and self.share > 0:
            raise StrategyError(f"dwell.time must be 0 where dwell.share is {self.share:g}, not {self.time:g} s")


@dataclass(frozen=True)
class AmplitudeModulation:
    """Intensity times a wave between 1 - depth and 1, at its lowest at time 0."""

    frequency: float = 200.0
    """[Hz]; Pacinian corpuscles are most sensitive at 200..250."""
    depth: float = 1.0
    wave: str = "sine"
    """Or "square"."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_number("am.frequency", self.frequency, 1e-3, 20_000.0)
        require_number("am.depth", self.depth, 0, 1)
        require_choice("am.wave", self.wave, ("sine", "square"))


@dataclass(frozen=True)
class LateralModulation:
    """A small circle around each focal point, in the plane of the palm (hand frame: from +X towards -Z)."""

    radius: float = 0.003
    """[m]"""
    frequency: float = 200.0
    """Turns a second [Hz]."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_number("lm.radius", self.radius, 0, 0.05)
        require_number("lm.frequency", self.frequency, 1e-3, 20_000.0)


@dataclass(frozen=True)
class Sections:
    """Contours cut in sections of equal length, drawn one after the other, each there and back many times.

    A section gets its share of the cycle (`pace.frequency`), those that hold a corner together `dwell.share` of it.
    Passes through a section are odd in number, so that it ends where the next begins.
    """

    count: int = 24
    speed: float = 2.0
    """[m/s], as near as whole passes allow."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_number("sections.count", self.count, 2, 1000, whole=True)
        require_number("sections.speed", self.speed, 1e-3, 100.0)


@dataclass(frozen=True)
class SamplingStrategy:
    """How contours become focal points; by default spatio-temporal modulation at constant speed.

    Raises StrategyError for a value out of its range, naming field, value and bound, and for groups that exclude
    each other.
    """

    speed: float = 7.0
    """Of a focal point along the contours [m/s]."""
    update_rate: float = 10_000.0
    """Focal points a second [Hz]: the array's carrier / n."""
    hold: float = 0.1
    """How long a pose is drawn while the next one is missing [s], but at least twice the poses' median interval."""
    fade: float = 0.02
    """How long the intensity then takes to 0 [s], the focal point still moving."""
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
    """Where drawing goes on when a new pose has another number of polylines: at the "nearest" point, there once the
    piece under way is finished ("finish"), or at the start of the new contours ("jump")."""

    def __post_init__(self) -> None:
        """Refuse what is not a motion of focal points."""
        for name, low, high in (
            ("speed", 1e-3, 100.0),
            ("update_rate", 1.0, 40_000.0),
            ("hold", 0, 60),
            ("fade", 0, 60),
        ):
            require_number(name, getattr(self, name), low, high)
        for name, kind in GROUPS.items():
            value = getattr(self, name)
            if not (isinstance(value, kind) or (value is None and name in OPTIONAL)):
                raise StrategyError(f"{name} must be a {kind.__name__}, not {value!r}")
        require_number("foci", self.foci, 1, 64, whole=True)
        require_choice("continuity", self.continuity, ("nearest", "finish", "jump"))
        self._require_agreement()

    def _require_agreement(self) -> None:
        """Refuse groups that exclude each other."""
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
        """A longer step is a jump [m]: max(2 v / f_s, 5 mm), v that of a fast return where there is one."""
        return max(2.0 * self._fastest / self.update_rate, JUMP_LENGTH)

    @property
    def step_ordinary(self) -> float:
        """Longest step along a contour at the nominal speeds, fast returns and small circles included [m].

        A step of more than twice that is a hop, unless it is a jump. For pace.kind "frequency" and "capped" the
        contours decide how fast a focal point runs: see `Track.step_ordinary`.
        """
        return self._fastest / self.update_rate + self.circle_step

    @property
    def circle_step(self) -> float:
        """What a small circle adds to a step, at most [m]."""
        return 0.0 if self.lm is None else 2 * math.pi * self.lm.radius * self.lm.frequency / self.update_rate

    @property
    def _fastest(self) -> float:
        """[m/s]"""
        return max(self.speed, self.gap.speed) if self.gap.kind == "return" else self.speed

    @property
    def plain(self) -> bool:
        """Whether a contour's arc length is all there is to a cycle: no pauses, no way back, no sections."""
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

    def samples_of(self, seconds: float) -> int:
        """Samples of a cycle that takes so long at the nominal speeds [s]; see `Pace`."""
        pace, rate = self.pace, self.update_rate
        if pace.kind == "still":
            count = 1
        elif pace.kind == "frequency":
            count = round(rate / pace.frequency)
        else:
            count = math.ceil(seconds * rate - SEAM)
            if pace.kind == "capped":
                fewest, most = pace.samples_within(rate)
                count = min(max(count, fewest), most)
        if self.order.kind in ("step", "random"):
            count = max(count, self.pace.points or 1)
        return max(count, 1)

    def samples_a_cycle(self, length: float) -> int:
        """Samples on contours of that length [m] without pauses or returns: N = ceil(f_s L / v) at constant speed."""
        return self.samples_of(length / self.speed)

    def described(self) -> dict[str, Any]:
        """Every field, for JSON."""
        return asdict(self)

    def to_json(self) -> str:
        """One line of JSON that `from_json` reads back."""
        return json.dumps(self.described())

    @classmethod
    def from_json(cls, text: str) -> "SamplingStrategy":
        """Read back what `to_json` wrote; missing fields take their defaults.

        Raises StrategyError for what is not JSON, for unknown fields and for values out of range.
        """
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
