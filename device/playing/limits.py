"""How long and how hard an array may be driven, and who watches it."""

from __future__ import annotations

import json
import reprlib
import sys
from array import array
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Final, NamedTuple, cast

import numpy as np

from ..array import ArrayModel
from ..codec import duty, is_emitting
from ..errors import LimitsError, SafetyLimitError

_BUCKET_NS: Final = 1_000_000_000


@dataclass(frozen=True)
class Limits:
    """Bounds of a playback; beyond one of them it ends with the array off. None lifts a bound: say so on purpose.

    The defaults are this project's own caution, no maker's figures: arrays warm up, and none of those supported here
    measures its temperature. They hold across the playbacks of one `Player`, not across processes.

    Raises `LimitsError`, naming the field.

    >>> from palpate.device import Limits, Player, VirtualClock, array_model, open_link
    >>> with open_link(array_model("emulator"), clock=VirtualClock()) as link:
    ...     Player(link, limits=Limits(on_time_max=0.05)).play([bytes([255] * 512) * 1000], update_rate=10e3)  # 100 ms
    Traceback (most recent call last):
        ...
    palpate.device.errors.SafetyLimitError: array emulator was stopped at a limit: it was about to emit for more than
    0.05 s without a pause of 1 s (on_time_max)
    """

    on_time_max: float | None = 120.0
    """Longest emission without a pause [s]."""
    pause_min: float = 1.0
    """Silence from which on it counts as a pause [s]."""
    duty_max: float | None = 0.5
    """Highest mean duty over `duty_window`, 0..1: 1 is every transducer at full drive all the time. By default an
    array at full drive plays for 5 of any 10 minutes."""
    duty_window: float = 600.0
    """Sliding window [s]; what was before the first playback counts as silence."""

    def __post_init__(self) -> None:
        for name in ("on_time_max", "pause_min", "duty_window"):
            value = getattr(self, name)
            if not (value is None and name == "on_time_max") and not _is_number(value, above=0.0):
                raise LimitsError(f"{name} is {_shown(value)}, but it must be a time above 0 s")
        if self.duty_max is not None and not (_is_number(self.duty_max, above=0.0) and self.duty_max <= 1):
            raise LimitsError(f"duty_max is {_shown(self.duty_max)}, but it must be above 0, at most 1, or None")

    def to_json(self) -> str:
        """One line of JSON that `from_json` reads back."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Limits:
        """Read back what `to_json` wrote; missing fields take their defaults. Raises `LimitsError`, as `Limits`."""
        try:
            values: object = json.loads(text)
        except RecursionError:
            raise LimitsError("limits: not JSON that can be read (nested too deeply)") from None
        except ValueError as error:  # JSONDecodeError, and Python's own bound on the digits of an integer
            raise LimitsError(f"limits: not JSON that can be read ({error})") from error
        if not isinstance(values, Mapping):
            raise LimitsError(f"limits: must be a JSON object, not {type(values).__name__}")
        known = {field.name for field in fields(cls)}
        given = cast("Mapping[str, float | None]", values)
        if unknown := sorted(set(given) - known):
            raise LimitsError(f"limits: unknown field {unknown[0]!r}; known: {', '.join(sorted(known))}")
        return cls(**given)  # pyright: ignore[reportArgumentType]  # __post_init__ refuses values of a wrong type


def _is_number(value: object, *, above: float) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return above < value <= sys.float_info.max


def _shown(value: object) -> str:
    """For a message, whatever it is: also an integer of more digits than Python writes."""
    if isinstance(value, int) and value.bit_length() > 64:
        return f"an integer of {value.bit_length()} bits"
    return reprlib.repr(value)


class Dose(NamedTuple):
    """What some frames in a row do."""

    frames: int
    first_on: int | None
    """The first that emits; None: all are silent."""
    last_on: int | None
    """The last that emits."""
    duty_sum: float
    """Sum of their duties."""
    duty_last: float
    """Duty of the last, which plays on if nothing follows."""


def _dose(on: list[bool], level: list[float]) -> Dose:
    if True not in on:
        return Dose(len(on), None, None, 0.0, 0.0)
    return Dose(len(on), on.index(True), len(on) - 1 - on[::-1].index(True), sum(level), level[-1])


class Guard:
    """Watches the frames of one array against its limits. Times are estimates of when frames play [ns].

    | last frame | until the next | counts as |
    |---|---|---|
    | emits | it plays on | emission, at its duty |
    | silent, or none yet | | pause, once it is `pause_min` long |
    """

    def __init__(self, limits: Limits, model: ArrayModel) -> None:
        self.limits = limits
        self.on_time_ns = 0
        """Longest emission without a pause since `start`."""
        self._model = model
        self._on_since_ns: int | None = None  # start of the emission without a pause that was last
        self._silent_since_ns: int | None = None  # None while the last frame emits
        self._duty_last = 0.0
        self._buckets: deque[tuple[int, float]] = deque()  # (start, driven time [ns]) of a second each
        self._driven_ns = 0.0
        self._end_ns = 0

    def start(self) -> None:
        """A playback begins, the array silent."""
        self.on_time_ns = 0

    def measure(self, data: array[int], chunk_frames: int) -> list[Dose]:
        """What whole frames do, in chunks of so many."""
        frames = np.frombuffer(data, np.uint8).reshape(-1, self._model.frame_bytes)
        on = cast("list[bool]", is_emitting(frames, array=self._model).tolist())
        level = cast("list[float]", duty(frames, array=self._model).tolist())
        return [
            _dose(on[start : start + chunk_frames], level[start : start + chunk_frames])
            for start in range(0, len(on), chunk_frames)
        ]

    def admit(self, dose: Dose, start_ns: int, period_ns: int) -> None:
        """Frames are to play from `start_ns` on; raises `SafetyLimitError` if that would go beyond a limit.

        They must be fewer than make a pause: a pause inside them is not looked for.
        """
        self._hold_until(start_ns)
        if self._on_since_ns is not None and self._silent_since_ns is None and dose.first_on != 0:
            self._silent_since_ns = start_ns
        if dose.first_on is not None and dose.last_on is not None:
            first_ns = start_ns + dose.first_on * period_ns
            last_ns = start_ns + (dose.last_on + 1) * period_ns
            if self._paused(first_ns) or self._on_since_ns is None:
                self._on_since_ns = first_ns
            self._silent_since_ns = None if dose.last_on == dose.frames - 1 else last_ns
            self._check_on_time(last_ns)
        self._duty_last = dose.duty_last
        self._end_ns = start_ns + dose.frames * period_ns
        self._drive(start_ns, dose.duty_sum * period_ns)

    def hold(self, now_ns: int) -> None:
        """Nothing new yet: the last frame plays on. Raises `SafetyLimitError` beyond a limit."""
        if self._silent_since_ns is None and self._on_since_ns is not None:
            self._check_on_time(now_ns)
        self._hold_until(now_ns)

    def silence(self, now_ns: int) -> None:
        """The array is off from now on."""
        if self._on_since_ns is not None and self._silent_since_ns is None:
            self._silent_since_ns = now_ns
        self._duty_last = 0.0

    def near(self, now_ns: int, share: float) -> list[str]:
        """Limits of which more than a share is used up, a sentence each that begins with the field."""
        sentences: list[str] = []
        limits, is_on = self.limits, self._on_since_ns is not None and self._silent_since_ns is None
        on_time = (now_ns - (self._on_since_ns or 0)) * 1e-9 if is_on else 0.0
        if limits.on_time_max is not None and on_time > share * limits.on_time_max:
            left = max(limits.on_time_max - on_time, 0.0)
            sentences.append(
                f"on_time_max: it will be stopped in {left:.0f} s unless it is silent for {limits.pause_min:g} s"
            )
        used = self._driven_ns / (limits.duty_window * 1e9)
        if limits.duty_max is not None and used > share * limits.duty_max:
            sentences.append(
                f"duty_max: its mean duty over {limits.duty_window:g} s is {used:.2g}, and it will be stopped above "
                f"{limits.duty_max:g}"
            )
        return sentences

    @property
    def model(self) -> ArrayModel:
        """The array."""
        return self._model

    def _hold_until(self, now_ns: int) -> None:
        """The last frame has played on until now; what is older than the window no longer counts."""
        if self._duty_last and now_ns > self._end_ns:
            held_ns = int(min(now_ns - self._end_ns, self.limits.duty_window * 1e9))
            self._end_ns = now_ns
            self._drive(now_ns - held_ns, self._duty_last * held_ns)

    def _paused(self, first_ns: int) -> bool:
        return self._silent_since_ns is not None and first_ns - self._silent_since_ns >= self.limits.pause_min * 1e9

    def _check_on_time(self, end_ns: int) -> None:
        on_time_ns = end_ns - (end_ns if self._on_since_ns is None else self._on_since_ns)
        limit = self.limits.on_time_max
        if limit is not None and on_time_ns > limit * 1e9:
            raise SafetyLimitError(
                f"array {self._model.name} was stopped at a limit: it was about to emit for more than {limit:g} s "
                f"without a pause of {self.limits.pause_min:g} s (on_time_max)"
            )
        self.on_time_ns = max(self.on_time_ns, on_time_ns)

    def _drive(self, start_ns: int, driven_ns: float) -> None:
        bucket_ns = start_ns // _BUCKET_NS * _BUCKET_NS
        if self._buckets and self._buckets[-1][0] >= bucket_ns:
            bucket_ns, before = self._buckets.pop()
            self._buckets.append((bucket_ns, before + driven_ns))
        else:
            self._buckets.append((bucket_ns, driven_ns))
        self._driven_ns += driven_ns
        window_ns = self.limits.duty_window * 1e9
        while self._buckets[0][0] <= bucket_ns - window_ns:
            self._driven_ns -= self._buckets.popleft()[1]
        limit = self.limits.duty_max
        if limit is not None and self._driven_ns > limit * window_ns:
            raise SafetyLimitError(
                f"array {self._model.name} was stopped at a limit: it was about to be driven at a mean duty "
                f"above {limit:g} over {self.limits.duty_window:g} s (duty_max)"
            )
