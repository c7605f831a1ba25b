"""Arrays of transducers: where each stands, where it points, and what its board takes."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import UnknownArrayError, UpdateRateError


@dataclass(frozen=True)
class FocalZone:
    """Where an array can focus, in the array frame."""

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
    """What a board says of itself on the bus; ids meant for tests are shared, so the strings decide."""

    vendor: int
    product: int
    manufacturer_string: str
    product_string: str


@dataclass(frozen=True, eq=False)
class ArrayModel:
    """An array. Everything is in the array frame: origin in the middle of the face, +z out of it."""

    name: str
    """Name on the command line."""
    position: NDArray[np.float32]
    """Middle of each transducer's face [m], shape [transducer, 3]; row by row, x fastest, from the corner (-x, -y)."""
    normal: NDArray[np.float32]
    """Unit vector out of each transducer, shape [transducer, 3]."""
    carrier: float
    """Frequency of the ultrasound [Hz]."""
    divider_min: int
    """Smallest divider of the carrier that gives an update rate."""
    divider_max: int
    """Largest divider."""
    frame_bytes: int
    """Bytes of one frame on the wire."""
    focal_zone: FocalZone
    """Where it can focus."""
    usb: UsbIdentity
    """How it is found on the bus."""
    embedded: bool
    """True for an array that exists only as an emulated board."""

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

    def update_rate(self, divider: int) -> float:
        """Frames a second [Hz] at a divider; raises `UpdateRateError` outside divider_min..divider_max."""
        if not self.divider_min <= divider <= self.divider_max:
            raise UpdateRateError(
                f"divider {divider} is outside {self.divider_min}..{self.divider_max} of array {self.name}"
            )
        return self.carrier / divider

    def divider(self, update_rate: float) -> int:
        """Divider for an update rate [Hz]; raises `UpdateRateError` unless it is carrier / n to 1 part in 10^6."""
        slowest, fastest = self.carrier / self.divider_max, self.carrier / self.divider_min
        if not slowest * (1 - 1e-6) <= update_rate <= fastest * (1 + 1e-6):
            raise UpdateRateError(
                f"update rate {update_rate:g} Hz is outside {slowest:.6g}..{fastest:.6g} Hz of array {self.name}"
            )
        divider = round(self.carrier / update_rate)
        if abs(self.carrier / divider - update_rate) > 1e-6 * update_rate:
            above = int(self.carrier / update_rate)
            raise UpdateRateError(
                f"update rate {update_rate:g} Hz is not {self.carrier:g} Hz / n, as array {self.name} needs; "
                f"nearest are {self.carrier / (above + 1):.9g} and {self.carrier / above:.9g} Hz"
            )
        return divider


def array_names() -> tuple[str, ...]:
    """Names of the built-in arrays."""
    return tuple(_BUILDERS)


def array_model(name: str) -> ArrayModel:
    """The built-in array of that name; raises `UnknownArrayError`."""
    try:
        return _BUILDERS[name]()
    except KeyError:
        raise UnknownArrayError(f"unknown array {name!r}; known: {', '.join(_BUILDERS)}") from None


def _emulator() -> ArrayModel:
    """The fictional board of docs/emulator.md."""
    position, normal = _flat_grid(count=16, pitch=10.5e-3)
    return ArrayModel(
        name="emulator",
        position=position,
        normal=normal,
        carrier=40e3,
        divider_min=1,
        divider_max=255,
        frame_bytes=512,
        focal_zone=FocalZone(lateral=0.15, z_min=0.05, z_max=0.5),
        usb=UsbIdentity(0x1209, 0x0001, "palpate", "emulated 256-transducer array"),
        embedded=True,
    )


def _flat_grid(*, count: int, pitch: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Positions [m] and normals of count x count transducers in the plane z = 0, facing +z, x fastest; read-only."""
    axis = (np.arange(count) - (count - 1) / 2) * pitch
    y, x = np.meshgrid(axis, axis, indexing="ij")
    position = np.stack([x.ravel(), y.ravel(), np.zeros(count * count)], axis=1).astype(np.float32)
    normal = np.zeros_like(position)
    normal[:, 2] = 1
    position.flags.writeable = False
    normal.flags.writeable = False
    return position, normal


_BUILDERS = {"emulator": _emulator}
