"""The vendor's recorder of an AUTD3: its firmware, and what each of its transducers puts out, every 25 us."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import autd3 as vendor
import autd3_emulator
import numpy as np

PERIOD_NS = 25_000
ORIGIN = np.array([0.08636, 0.06604, 0.0])  # [m], of the array frame, in the vendor's


class RecordingChannel:
    """The vendor's recorder of one array, with the clock that it runs by: time passes where somebody waits.

    The recorder belongs to the thread that made it, so it has one of its own.
    """

    name = "recorded"

    def __init__(self, *, datagram_ns: int = 0) -> None:
        self.clock = self
        self.sends = self.datagrams = 0
        self.failing: vendor.Autd3Error | None = None
        self._datagram_ns = datagram_ns
        self._periods = 0
        self._geometry = vendor.geometry.Geometry([vendor.geometry.Autd3()])
        self._thread = ThreadPoolExecutor(1)
        self._recorder = None
        self._do(self._make)

    def now_ns(self) -> int:
        return self._periods * PERIOD_NS

    def sleep_until_ns(self, time_ns: int) -> None:
        periods = -(-time_ns // PERIOD_NS) - self._periods
        if periods > 0:
            self._periods += periods
            self._do(lambda: self._recorder.tick(vendor.Duration.from_nanos(periods * PERIOD_NS)))

    def send(self, command) -> None:
        self.sends += 1
        if self.failing:
            raise self.failing
        count = len(vendor.Frames.encode(self._geometry, command))
        self.datagrams += count
        self.sleep_until_ns(self.now_ns() + count * self._datagram_ns)
        self._do(lambda: self._recorder.send(command))

    def state(self) -> None:
        return None

    def is_lost(self) -> bool:
        return False

    def close(self) -> None:
        pass  # what the array does afterwards is recorded too

    def record(self) -> np.ndarray:
        """What was put out, shape [period, 498]: phases [1/256 turn], then pulse widths [1/512 period]."""
        return self._do(self._read)

    def peak(self, time_ns: int, about: np.ndarray) -> np.ndarray:
        """Where the vendor's field is highest in a period, of places 1 mm apart in the plane about a point [m].

        Both in the array frame, which has its origin in the middle of the face; the vendor's is in transducer 0.
        """
        return self._do(lambda: self._seek(time_ns, (about + ORIGIN) * 1e3)) * 1e-3 - ORIGIN

    def field(self, time_ns: int, about: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The vendor's RMS pressure [Pa] in a period at the places of `peak` [m], which come first."""
        places, pressure = self._do(lambda: self._observe(time_ns, (about + ORIGIN) * 1e3))
        return places.T * 1e-3 - ORIGIN, pressure

    def dispose(self) -> None:
        self._do(self._drop)
        self._thread.shutdown()

    def _do(self, action):
        return self._thread.submit(action).result()

    def _make(self) -> None:
        self._recorder = autd3_emulator.Recorder(self._geometry, 0)

    def _drop(self) -> None:
        self._recorder = None

    def _seek(self, time_ns: int, about: np.ndarray) -> np.ndarray:
        places, pressure = self._observe(time_ns, about)
        return places[:, pressure.argmax()]

    def _observe(self, time_ns: int, about: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y = [(float(middle) - 10, float(middle) + 10) for middle in about[:2]]
        option = autd3_emulator.RmsRecordOption(sound_speed=vendor.units.Velocity.from_m_s(343.0))
        grid = autd3_emulator.Grid(x, y, float(about[2]), 1.0, "xyz")
        field = self._recorder.into_record().sound_field(grid, option)
        field.skip(vendor.Duration.from_nanos(time_ns))
        pressure = _rows(field.next(vendor.Duration.from_nanos(PERIOD_NS)), float)[0]
        return _rows(field.observe_points(), float), pressure

    def _read(self) -> np.ndarray:
        record = self._recorder.into_record()
        return np.concatenate([_rows(record.phase()), _rows(record.pulse_width())], axis=1)


def _rows(table, dtype: type = np.int64) -> np.ndarray:
    return np.stack([table[name].to_numpy() for name in table.columns]).astype(dtype)


def pulse_width(level: np.ndarray) -> np.ndarray:
    """Pulse width [1/512 period] whose fundamental is level / 255 of the greatest."""
    return 512 * np.arcsin(level / 255) / np.pi


def assert_plays(recorded: np.ndarray, frames: np.ndarray, divider: int) -> None:
    """Each frame for `divider` periods, one after the other, all in `recorded`, which begins with the first one."""
    expected = np.repeat(frames, divider, axis=0).astype(np.int64)
    got = recorded[: len(expected)]
    assert len(got) == len(expected)
    np.testing.assert_array_equal(got[:, :249], expected[:, :249])
    assert np.abs(got[:, 249:] - pulse_width(expected[:, 249:])).max() <= 0.51


def is_emitting(recorded: np.ndarray) -> np.ndarray:
    return recorded[:, 249:].any(axis=1)
