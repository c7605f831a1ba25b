"""Arrays of transducers: where each stands, where it points, and what its board takes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .array_name import ALIASES, canonical_name
from .boards.pat16.board_file import CalibrationError, read_pat
from .errors import UpdateRateError

_Number = TypeVar("_Number", bound=np.generic)


@dataclass(frozen=True)
class FocalZone:
    """Where an array can focus, in its own frame."""

    lateral: float
    """Bound of |x| and |y| [m]."""
    z_min: float
    """Nearest height [m]."""
    z_max: float
    """Farthest height [m]."""

    def contains(self, point: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Which points [m], shape [point, 3], lie in the zone (its boundary included); NaN does not."""
        position = np.asarray(point)
        inside = np.abs(position[..., :2]).max(axis=-1) <= self.lateral
        return inside & (position[..., 2] >= self.z_min) & (position[..., 2] <= self.z_max)


@dataclass(frozen=True)
class UsbIdentity:
    """What a board says of itself on the bus.

    Ids meant for tests are shared, so there the strings decide. The ids of an FTDI chip tell the chip only, and many
    things have one: then the strings are None, and what has the ids may be the array.
    """

    vendor: int
    product: int
    manufacturer_string: str | None
    product_string: str | None

    @property
    def generic(self) -> bool:
        """True where the ids are those of a chip that many things have."""
        return self.product_string is None


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayModel:
    """An array. Its own frame has its origin in the middle of the face and +z out of it.

    `position` and `normal` are in the common frame: the array's own, unless it was `placed`.
    """

    name: str
    """Name on the command line."""
    position: NDArray[np.float32]
    """Middle of each transducer's face [m], shape [transducer, 3]; row by row, x fastest, from the corner (-x, -y)."""
    normal: NDArray[np.float32]
    """Unit vector out of each transducer, shape [transducer, 3]."""
    carrier: float
    """Frequency of the ultrasound [Hz]."""
    frame_clock: float
    """Frames a second at divider 1 [Hz]: update rate = frame_clock / divider."""
    frame_clock_reason: str
    """Where the frame clock comes from, for messages: "its frame clock is 40 kHz"."""
    divider_min: int
    """Smallest divider."""
    divider_max: int
    """Largest divider."""
    divider_default: int
    """Divider where no update rate is asked for."""
    divider_sustained: int
    """Smallest divider that can be kept up: below it only bursts of `burst_frames` can be played."""
    burst_frames: int
    """Most frames of a burst below `divider_sustained`; 0 where there is no such limit."""
    fifo_frames: int
    """Frames that board and USB chip may hold beyond what the host sees as sent."""
    frame_bytes: int
    """Bytes of one frame on the wire."""
    wire_order: NDArray[np.intp]
    """Transducer at each place of the wire, shape [transducer]."""
    delay_offset: NDArray[np.float32]
    """Delay that each transducer has of itself, taken off on the wire [turns], shape [transducer]."""
    gain: NDArray[np.float32]
    """Factor on each transducer's amplitude, 0..1, shape [transducer]."""
    calibrated: bool
    """False where wiring, delays and gains of a single board differ, and its own were not given."""
    focal_zone: FocalZone
    """Where it can focus, in its own frame."""
    usb: UsbIdentity | None
    """How it is found on the bus; None: not by USB."""
    embedded: bool
    """True for an array that exists only as an emulated board."""
    baud: int | None = None
    """Rate of its UART [Bd]; None: it has none."""
    serial: str | None = None
    """Serial number of the board that was calibrated; None: any."""
    pose: NDArray[np.float64]
    """Own frame -> common frame: position [m] and quaternion xyzw, shape [7]."""
    unplaced: ArrayModel | None = None
    """The array in its own frame, where this one was placed."""

    @property
    def transducer_count(self) -> int:
        """Number of transducers."""
        return len(self.position)

    def identity(self) -> str:
        """SHA-256 of the geometry (positions, normals, carrier), hexadecimal: drives fit any array with the same."""
        digest = hashlib.sha256(np.array([self.transducer_count, self.carrier], "<f8").tobytes())
        digest.update(self.position.astype("<f4").tobytes())
        digest.update(self.normal.astype("<f4").tobytes())
        return digest.hexdigest()

    def placed(self, pose: ArrayLike) -> ArrayModel:
        """The array standing at a pose in the common frame; one that was placed before is placed anew.

        Args:
            pose: own frame -> common frame, position [m] and quaternion xyzw, shape [7]; its norm within 1e-3 of 1.

        Raises:
            ValueError: another shape, a value that is not finite, or another norm.
        """
        own = self.unplaced or self
        where = np.array(pose, np.float64)
        if where.shape != (7,):
            raise ValueError(f"pose has shape {where.shape}, but an array's is (7,): position and quaternion xyzw")
        norm = float(np.linalg.norm(where[3:]))
        if not (np.isfinite(where).all() and abs(norm - 1) <= 1e-3):
            raise ValueError(
                f"pose {where.tolist()} must be finite, its quaternion's norm within 1e-3 of 1, not {norm:g}"
            )
        where[3:] /= norm
        rotation = _rotation(where[3:])
        return replace(
            own,
            position=_frozen((own.position.astype(np.float64) @ rotation.T + where[:3]).astype(np.float32)),
            normal=_frozen((own.normal.astype(np.float64) @ rotation.T).astype(np.float32)),
            pose=_frozen(where),
            unplaced=own,
        )

    def in_reach(self, point: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Which points [m] of the common frame, shape [point, 3], lie in this array's focal zone; NaN does not."""
        if self.unplaced is None:
            return self.focal_zone.contains(point)
        own = (np.asarray(point, np.float64) - self.pose[:3]) @ _rotation(self.pose[3:])
        return self.focal_zone.contains(own.astype(np.float32))  # as points are: 0.15 m is in reach of 0.15 m

    def update_rate(self, divider: int) -> float:
        """Frames a second [Hz] at a divider; raises `UpdateRateError` outside divider_min..divider_max."""
        if not self.divider_min <= divider <= self.divider_max:
            raise UpdateRateError(
                f"divider {divider} is outside {self.divider_min}..{self.divider_max} of array {self.name}"
            )
        return self.frame_clock / divider

    def divider(self, update_rate: float) -> int:
        """Divider for an update rate [Hz]; raises `UpdateRateError` unless it is frame_clock / n to 1 part in 10^6."""
        slowest, fastest = self.frame_clock / self.divider_max, self.frame_clock / self.divider_min
        if not slowest * (1 - 1e-6) <= update_rate <= fastest * (1 + 1e-6):
            span = f"{slowest:.6g}" if slowest == fastest else f"{slowest:.6g}..{fastest:.6g}"
            raise UpdateRateError(
                f"update rate {update_rate:g} Hz is outside {span} Hz of array {self.name}: {self.frame_clock_reason}"
            )
        divider = round(self.frame_clock / update_rate)
        if abs(self.frame_clock / divider - update_rate) > 1e-6 * update_rate:
            above = int(self.frame_clock / update_rate)
            raise UpdateRateError(
                f"update rate {update_rate:g} Hz is not {self.frame_clock:g} Hz / n, as array {self.name} needs; "
                f"nearest are {self.frame_clock / (above + 1):.9g} and {self.frame_clock / above:.9g} Hz"
            )
        return divider


def array_names() -> tuple[str, ...]:
    """Names of the built-in arrays."""
    return tuple(ALIASES)


def array_model(name: str, *, calibration: Path | None = None, baud: int | None = None) -> ArrayModel:
    """The built-in array of that name.

    Args:
        name: one of `array_names()`, or what else it is called (`openmpd`), in any case; the model has the first.
        calibration: board file (`.pat`) with the wiring and calibration of one board; for pat16 only.
        baud: rate of the UART [Bd]; for sonicsurface only, 230400 unless its firmware was compiled for another.

    Raises:
        UnknownArrayError: no array of that name.
        CalibrationError: the board file is wrong, or none of this array's.
        UpdateRateError: no serial adapter has that baud rate.
    """
    name = canonical_name(name)
    if calibration is not None and name != "pat16":
        raise CalibrationError(f"array {name} has no board file; {calibration} is one of a pat16")
    if baud is not None and name != "sonicsurface":
        raise UpdateRateError(f"array {name} has no UART, so {baud} Bd mean nothing to it")
    if name == "sonicsurface":
        return _sonicsurface(SONICSURFACE_BAUD if baud is None else baud)
    return _BUILDERS[name]() if calibration is None else _calibrated_pat16(calibration)


def _frozen(value: NDArray[_Number]) -> NDArray[_Number]:
    value.flags.writeable = False
    return value


def _rotation(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrix of a unit quaternion xyzw, shape [3, 3]; it maps own vectors to common ones."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _flat_grid(column_count: int, row_count: int, pitch: float) -> NDArray[np.float32]:
    """Positions [m] of transducers in the plane z = 0 about its middle, shape [transducer, 3], x fastest."""
    x = (np.arange(column_count) - (column_count - 1) / 2) * pitch
    y = (np.arange(row_count) - (row_count - 1) / 2) * pitch
    row, column = np.meshgrid(y, x, indexing="ij")
    return np.stack([column.ravel(), row.ravel(), np.zeros(row.size)], axis=1).astype(np.float32)


def _facing_up(name: str, position: NDArray[np.float32], wire_order: NDArray[np.intp], **rest: object) -> ArrayModel:
    """A model of transducers that all face +z, delays and gains of which are not known to differ."""
    count = len(position)
    values = {
        "normal": _frozen(np.tile(np.array([0, 0, 1], np.float32), (count, 1))),
        "carrier": 40e3,
        "frame_clock": 40e3,
        "frame_clock_reason": "its frame clock is 40 kHz",
        "divider_min": 1,
        "divider_max": 255,
        "divider_default": 4,
        "divider_sustained": 1,
        "burst_frames": 0,
        "delay_offset": _frozen(np.zeros(count, np.float32)),
        "gain": _frozen(np.ones(count, np.float32)),
        "calibrated": True,
        "focal_zone": FocalZone(lateral=0.15, z_min=0.05, z_max=0.5),
        "embedded": False,
        "pose": _frozen(np.array([0, 0, 0, 0, 0, 0, 1.0])),
    }
    fields = {"name": name, "position": _frozen(position), "wire_order": _frozen(wire_order), **values, **rest}
    return ArrayModel(**fields)  # pyright: ignore[reportArgumentType]  # a dict of unlike values; tests build each model


@cache
def _emulator() -> ArrayModel:
    """The fictional board of docs/formats/emulator.md."""
    # its wire runs along columns like a snake: columns from +x to -x, the first from +y down, the next up, in turn
    column, step = np.divmod(np.arange(256), 16)
    order = np.where(column % 2 == 0, 15 - step, step) * 16 + (15 - column)
    return _facing_up(
        "emulator",
        _flat_grid(16, 16, _PITCH),
        order,
        fifo_frames=2048,
        frame_bytes=512,
        usb=UsbIdentity(0x1209, 0x0001, "palpate", "emulated 256-transducer array"),
        embedded=True,
    )


@cache
def _pat16() -> ArrayModel:
    """A UCL/OpenMPD board as published board files describe it; each board needs its own (docs/guide/boards.md)."""
    return _facing_up(
        "pat16",
        _flat_grid(16, 16, _PITCH),
        np.argsort(_pat16_pins()),
        divider_sustained=3,
        burst_frames=28,
        fifo_frames=34,
        frame_bytes=512,
        calibrated=False,
        usb=UsbIdentity(0x0403, 0x6014, None, None),
    )


def _pat16_pins() -> NDArray[np.intp]:
    """Pin of each transducer, in our order: the board's layout repeats every 4 columns and 2 rows."""
    row, column = np.divmod(np.arange(256), 16)
    down = 15 - row
    corner = np.array([[1, 5], [0, 4], [3, 6], [2, 7]])
    return 248 - 64 * (column // 4) - 8 * (down // 2) + corner[column % 4, down % 2]


def _calibrated_pat16(path: Path) -> ArrayModel:
    """The board that a board file describes, its transducers put into our order."""
    file, board = read_pat(path), _pat16()
    count = board.transducer_count
    if len(file.pin) != count or file.levels != 128:
        raise CalibrationError(
            f"{path}: describes a board of {len(file.pin)} transducers and {file.levels} steps of phase, but a pat16 "
            f"has {count} and 128"
        )
    column, row = np.rint(file.position[:, :2].T / _PITCH + 7.5).astype(np.intp)
    rank = np.argsort(row * 16 + column)
    if (worst := np.abs(file.position[rank] - board.position).max()) > _PITCH / 2:
        raise CalibrationError(
            f"{path}: the positions are not 16 x 16 at 10.5 mm about the middle: one is {worst * 1e3:.4g} mm beside "
            "its place, but half a pitch is the bound"
        )
    return replace(
        board,
        position=_frozen(file.position[rank].astype(np.float32)),
        wire_order=_frozen(np.argsort(file.pin[rank])),
        delay_offset=_frozen((file.phase_offset[rank] / 360).astype(np.float32)),
        gain=_frozen(file.gain[rank].astype(np.float32)),
        calibrated=True,
        serial=file.serial,
    )


_PITCH = 10.5e-3  # [m]
SONICSURFACE_BAUD = 230400
"""Baud rate of SonicSurface's firmware as published [Bd]."""
_BITS_PER_BYTE = 10  # 8N1
_BAUD_LEAST, _BAUD_MOST = 1200, 12_000_000  # the fastest UART is an FT232H's


@cache
def _sonicsurface(baud: int) -> ArrayModel:
    """UpnaLab's SonicSurface, its UART behind a serial adapter."""
    frame_bytes = 258
    if not _BAUD_LEAST <= baud <= _BAUD_MOST:
        raise UpdateRateError(f"{baud} Bd is outside {_BAUD_LEAST}..{_BAUD_MOST} Bd, which serial adapters have")
    rate = baud / _BITS_PER_BYTE / frame_bytes
    # the board's layout repeats every 4 columns and 2 rows
    row, column = np.divmod(np.arange(256), 16)
    corner = np.array([[0, 7, 1, 2], [4, 3, 6, 5]])
    slot = 64 * (column // 4) + 8 * (row // 2) + corner[row % 2, column % 4]
    return _facing_up(
        "sonicsurface",
        _flat_grid(16, 16, _PITCH),
        np.argsort(slot),
        frame_clock=rate,
        frame_clock_reason=f"its UART carries {rate:.1f} frames a second at {baud} Bd",
        divider_max=1,
        divider_default=1,
        fifo_frames=3,  # adapters hold up to 640 bytes
        frame_bytes=frame_bytes,
        usb=None,
        baud=baud,
    )


@cache
def _autd3() -> ArrayModel:
    """shinolab's AUTD3: 18 x 14 places at 10.16 mm, three of them taken by its screws."""
    row, column = np.divmod(np.arange(18 * 14), 18)
    screw = (row == 1) & np.isin(column, (1, 2, 16))
    return _facing_up(
        "autd3",
        _flat_grid(18, 14, 10.16e-3)[~screw],
        np.arange(249),
        divider_max=20000,  # 2 Hz; the board has 65535, but a bank of one frame and an off pattern would take too long
        divider_sustained=4,  # 100 Mbit/s carry no more of frames that change; a bank takes 1023
        burst_frames=1023,
        fifo_frames=0,
        frame_bytes=498,
        usb=None,
    )


_BUILDERS: dict[str, Callable[[], ArrayModel]] = {"emulator": _emulator, "pat16": _pat16, "autd3": _autd3}
