"""A step of the first hour with a real board: what is played, the question, its answers, and which arrays have it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from ...device.array import ArrayModel
from ...device.registry import array_model, array_names
from .frames import FeltStimulus

Act = Literal["play", "stop", "unplug", "replug"]
"""What is done: play to the end, stop in the middle, have the plug pulled meanwhile, or plugged in again before."""

HEARD = 440.0  # [Hz], the A that instruments are tuned to: any tuner tells it
TURN_RADIUS = 0.02  # [m]

SLOW_DIVIDER = 45  # 889 frames a second of 40 kHz


def takes_phases(model: ArrayModel) -> bool:
    """Every array whose transducers can be driven one by one."""
    return not model.takes_points


def has_plug(model: ArrayModel) -> bool:
    """Arrays on USB, also behind a serial adapter: their plug can be pulled."""
    return model.usb is not None or model.baud is not None


def carries_tones(model: ArrayModel) -> bool:
    """Arrays fast enough for a tone that is heard, which can be slowed down, too."""
    return (
        takes_phases(model)
        and model.update_rate(model.divider_default) >= 4 * HEARD
        and model.divider_max >= SLOW_DIVIDER
    )


def is_behind_a_chip(model: ArrayModel) -> bool:
    """Arrays behind an FTDI chip, which limits their rate."""
    return model.usb is not None and model.usb.generic


@dataclass(frozen=True)
class Answer:
    """What a person can answer, and, where it is not the expected answer, what follows from it."""

    key: str
    """What is typed."""
    sentence: str
    meaning: str = ""
    """What a wrong answer means; "" of the expected one."""
    change: str = ""
    """Which file and line, or which setting, to change then."""


@dataclass(frozen=True)
class Step:
    """One question to a person, and what is played before it."""

    name: str
    instruction: str
    """What to do while it plays."""
    question: str
    answers: tuple[Answer, ...]
    """The expected one first."""
    stimuli: tuple[FeltStimulus, ...] = ()
    """What is played, one after the other."""
    act: Act = "play"
    suits: Callable[[ArrayModel], bool] = takes_phases
    """Which arrays the step makes sense for."""

    @property
    def arrays(self) -> tuple[str, ...]:
        """Names of the arrays that the step makes sense for."""
        return tuple(name for name in array_names() if self.suits(array_model(name)))

    @property
    def expected(self) -> str:
        """Key of the expected answer."""
        return self.answers[0].key

    def answer(self, key: str) -> Answer | None:
        """The answer of that key, None if there is none."""
        return next((answer for answer in self.answers if answer.key == key), None)
