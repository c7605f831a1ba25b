"""Events of a study as a stream of markers of the Lab Streaming Layer, beside other instruments' streams."""

import time
from typing import Any

from ...errors import StudyError
from ...terminal.foreign_text import visible

CONTENT_TYPE = "Markers"
"""By which recorders and toolboxes find streams of events."""


class LslOutlet:
    """An LSL stream of texts: one line of JSON an event, at the event's own time on LSL's clock.

    name: of the stream. Raises StudyError where pylsl or its library is missing. Programs of the whole local network
    see LSL streams, as LSL itself is configured.
    """

    def __init__(self, name: str) -> None:
        if not name or len(name) > 100 or not name.isprintable():
            raise StudyError(f"name of the LSL stream must be a text of 1 to 100 characters, not {name!r}")
        self.name = name
        self._lsl = _pylsl()
        # The source makes a recorder find the stream again after a study was resumed.
        info = self._lsl.StreamInfo(
            name, CONTENT_TYPE, 1, self._lsl.IRREGULAR_RATE, self._lsl.cf_string, f"palpate {name}"
        )
        self._outlet = self._lsl.StreamOutlet(info)

    def __repr__(self) -> str:
        return f"LslOutlet({self.name!r})"

    def push(self, line: str, array_time: float) -> None:
        """Push an event that happened at a time of the array's clock [s of time.monotonic()]; returns at once."""
        # Both clocks are CLOCK_MONOTONIC on Linux, but LSL promises no clock: so their offset is measured each time.
        before = time.monotonic()
        now = self._lsl.local_clock()
        offset = now - (before + time.monotonic()) / 2
        self._outlet.push_sample([line], array_time + offset)


def _pylsl() -> Any:
    way_out = "pip install 'palpate[lsl]'"
    try:
        import pylsl  # only where it is asked for: it loads a library of C++ and starts threads
    except ModuleNotFoundError as error:
        raise StudyError(f"an LSL stream needs pylsl, which is not installed: {way_out}") from error
    except (ImportError, RuntimeError, OSError) as error:  # RuntimeError: pylsl itself finds no liblsl
        reason = visible((str(error) or type(error).__name__).splitlines()[0])
        raise StudyError(
            f"pylsl cannot load its library liblsl ({reason}): {way_out} brings it to Linux on x86-64 with glibc 2.35 "
            "or newer; elsewhere install liblsl, and name its file in the environment variable PYLSL_LIB"
        ) from error
    return pylsl
