"""Arrays of transducers: where each stands, where it points, and what its board takes."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import FrameError, UpdateRateError

POINT_BYTES = 16
"""Of a focal point in a frame: float32 x, y, z [m] in the array's own frame, and intensity 0..1."""
POINTS_MOST = 8
"""Focal points that a frame can hold."""

_Number = TypeVar("_Number", bound=np.generic)


@dataclass(frozen=True)
class FocalZone:
    """Where an array can focus, in its own frame.

    >>> import numpy as np
    >>> from palpate.device import array_model
    >>> zone = array_model("emulator").focal_zone
    >>> zone
    FocalZone(lateral=0.15, z_min=0.05, z_max=0.5)
    >>> zone.contains(np.array([[0, 0, 0.2], [0, 0, 0.02]])).tolist()  # 20 cm above the array, and 2 cm
    [True, False]
    """

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

    >>> from palpate.device import array_model
    >>> usb = array_model("pat16").usb
    >>> f"{usb.vendor:04x}:{usb.product:04x}", usb.generic  # an FT232H, which other things have, too
    ('0403:6014', True)
    """

    vendor: int
    product: int
    manufacturer_string: str | None
    product_string: str | None

    def __repr__(self) -> str:
        """One line, with the ids as other tools write them."""
        return (
            f"UsbIdentity({self.vendor:04x}:{self.product:04x}, {self.manufacturer_string!r}, {self.product_string!r})"
        )

    @property
    def generic(self) -> bool:
        """True where the ids are those of a chip that many things have."""
        return self.product_string is None


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayModel:
    """An array of transducers. Its own frame has its origin in the middle of the face and +z out of it.

    `position` and `normal` are in the common frame: the array's own, unless it was `placed`.

    >>> from palpate.device import array_model
    >>> model = array_model("emulator")
    >>> model.transducer_count, model.update_rate(4), model.divider(20e3)
    (256, 10000.0, 2)
    >>> model.placed([0, 0, 0.4, 1, 0, 0, 0]).normal[0].tolist()  # 40 cm up, turned about x to face down
    [0.0, 0.0, -1.0]
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
    alternates: bool = False
    """Whether it plays any number of frames below `divider_sustained` if they are one pattern and off, in turns."""
    fifo_frames: int
    """Frames that board and USB chip may hold beyond what the host sees as sent."""
    frame_bytes: int
    """Bytes of one frame on the wire."""
    takes_points: bool = False
    """Whether a frame holds focal points, of 16 bytes each, from which the array's own driver finds the phases; else it
    holds the delays and levels of transducers."""
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

    def __repr__(self) -> str:
        """One line."""
        return f"ArrayModel({self.name!r}, {len(self.position)} transducers)"

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

    def wire_identity(self) -> str:
        """SHA-256 of all that wire bytes depend on, hexadecimal: kind, geometry, pose, wiring, own delays and gains.

        Frames play as they were meant on any array with the same. Poses are compared to 1e-6.

        >>> from palpate.device import array_model
        >>> model = array_model("emulator")
        >>> model.wire_identity() == model.placed([0, 0, 0.4, 1, 0, 0, 0]).wire_identity()
        False
        """
        own = self.unplaced or self
        digest = hashlib.sha256(f"{self.name} {self.frame_bytes} {own.identity()}".encode())
        digest.update((np.round(self.pose, 6) + 0.0).astype("<f8").tobytes())
        digest.update(self.wire_order.astype("<i8").tobytes())
        digest.update(np.concatenate([self.delay_offset, self.gain]).astype("<f4").tobytes())
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
        norm = float(np.sqrt(np.square(where[3:]).sum()))
        if not (np.isfinite(where).all() and abs(norm - 1) <= 1e-3):
            raise ValueError(
                f"pose {where.tolist()} must be finite, its quaternion's norm within 1e-3 of 1, not {norm:g}"
            )
        where[3:] /= norm
        rotation = _rotation(where[3:])
        return replace(
            own,
            position=frozen((_product(own.position.astype(np.float64), rotation.T) + where[:3]).astype(np.float32)),
            normal=frozen(_product(own.normal.astype(np.float64), rotation.T).astype(np.float32)),
            pose=frozen(where),
            unplaced=own,
        )

    @property
    def point_count(self) -> int:
        """Focal points of a frame; 0 for an array whose frames hold delays and levels."""
        return self.frame_bytes // POINT_BYTES if self.takes_points else 0

    def with_points(self, point_count: int) -> ArrayModel:
        """The array with frames of so many focal points; itself, where its frames hold none.

        Raises `FrameError` outside 1..8.

        >>> from palpate.device import array_model
        >>> array_model("stratos").with_points(4).frame_bytes, array_model("pat16").with_points(4).frame_bytes
        (64, 512)
        """
        if not self.takes_points:
            return self
        if not 1 <= point_count <= POINTS_MOST:
            raise FrameError(f"a frame of array {self.name} holds 1..{POINTS_MOST} focal points, not {point_count}")
        own = None if self.unplaced is None else self.unplaced.with_points(point_count)
        return replace(self, frame_bytes=point_count * POINT_BYTES, unplaced=own)

    def in_reach(self, point: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Which points [m] of the common frame, shape [point, 3], lie in this array's focal zone; NaN does not."""
        if self.unplaced is None:
            return self.focal_zone.contains(point)
        with np.errstate(invalid="ignore"):  # infinite points
            own = _product(np.asarray(point, np.float64) - self.pose[:3], _rotation(self.pose[3:]))
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
            is_kilohertz = slowest <= 1e3 * update_rate <= fastest
            hint = f"; rates are in hertz, {update_rate:g} kHz are {1e3 * update_rate:g}" if is_kilohertz else ""
            raise UpdateRateError(
                f"update rate {update_rate:g} Hz is outside {span} Hz of array {self.name}: {self.frame_clock_reason}"
                + hint
            )
        divider = round(self.frame_clock / update_rate)
        if abs(self.frame_clock / divider - update_rate) > 1e-6 * update_rate:
            above = int(self.frame_clock / update_rate)
            raise UpdateRateError(
                f"update rate {update_rate:g} Hz is not {self.frame_clock:g} Hz / n, as array {self.name} needs; "
                f"nearest are {self.frame_clock / (above + 1):.9g} and {self.frame_clock / above:.9g} Hz"
                + (f"; {self.frame_clock_reason}" if self.alternates else "")
            )
        return divider


def frozen(value: NDArray[_Number]) -> NDArray[_Number]:
    """The array itself, made read-only."""
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


def _product(vector: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows times a matrix, shape [..., 3]: summed in one order, where `@` rounds by shape and processor."""
    x, y, z = (vector[..., axis, None] * matrix[axis] for axis in range(3))
    return (x + y) + z
