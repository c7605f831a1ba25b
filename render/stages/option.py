"""Options of a stage: their defaults, their bounds, and what None stands for."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import StrategyError
from ..validation import number_text, require_choice, require_number

Value = float | int | str | bool | None


@dataclass(frozen=True)
class Option:
    """An option of a stage: its default and what else it may be."""

    default: Value = None
    """None stands for `widths` focal widths."""
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""
    choices: tuple[str, ...] = ()
    """Of a text."""
    widths: float = 1.0
    """What None is replaced by, in focal widths (FWHM of p^2 across the focus), within `low`..`high`."""

    def check(self, name: str, value: Value) -> None:
        """Refuse a value that this option cannot have; `name` is stage and option."""
        if value is None and self.default is None:
            return
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise StrategyError(f"{name} must be true or false, not {value!r}")
        elif isinstance(self.default, str):
            if self.choices:
                require_choice(name, value, self.choices)
            elif not isinstance(value, str):
                raise StrategyError(f"{name} must be a text, not {value!r}")
        else:
            require_number(name, value, self.low, self.high, unit=self.unit, whole=isinstance(self.default, int))
            if not abs(value or 0) <= sys.float_info.max:  # compared as it is: an int may be too large for a float
                raise StrategyError(f"{name} must be finite, not {number_text(value)}")

    def resolved(self, value: Value, focal_width: float) -> Value:
        """The value, or the number that None stands for [m]."""
        return min(max(self.widths * focal_width, self.low), self.high) if value is None else value


def options_of(name: str, defaults: Mapping[str, Value | Option]) -> dict[str, Option]:
    """Options from defaults: an Option as it is, else a value that later ones are like; None: one focal width."""
    for option, default in defaults.items():
        if not isinstance(default, Option | float | int | str | None):
            raise StrategyError(f"stage {name!r}: option {option!r} cannot default to {default!r}")
    return {key: value if isinstance(value, Option) else Option(value) for key, value in defaults.items()}
