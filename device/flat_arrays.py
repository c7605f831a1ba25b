"""Models of arrays whose transducers lie in one plane and face +z."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .array import ArrayModel, FocalZone, UsbIdentity, frozen


def flat_grid(column_count: int, row_count: int, pitch: float) -> NDArray[np.float32]:
    """Positions [m] in the plane z = 0 about its middle, shape [transducer, 3], x fastest; `pitch` in metres.

    >>> from palpate.device import flat_grid
    >>> flat_grid(3, 1, 10e-3)  # three columns, one row
    array([[-0.01,  0.  ,  0.  ],
           [ 0.  ,  0.  ,  0.  ],
           [ 0.01,  0.  ,  0.  ]], dtype=float32)
    """
    x = (np.arange(column_count) - (column_count - 1) / 2) * pitch
    y = (np.arange(row_count) - (row_count - 1) / 2) * pitch
    row, column = np.meshgrid(y, x, indexing="ij")
    return np.stack([column.ravel(), row.ravel(), np.zeros(row.size)], axis=1).astype(np.float32)


def flat_array(
    name: str,
    position: NDArray[np.float32],
    wire_order: NDArray[np.intp],
    *,
    frame_bytes: int,
    fifo_frames: int,
    usb: UsbIdentity | None = None,
    baud: int | None = None,
    embedded: bool = False,
    calibrated: bool = True,
    frame_clock: float = 40e3,
    frame_clock_reason: str = "its frame clock is 40 kHz",
    divider_max: int = 255,
    divider_default: int = 4,
    divider_sustained: int = 1,
    burst_frames: int = 0,
    alternates: bool = False,
    takes_points: bool = False,
    focal_zone: FocalZone | None = None,
) -> ArrayModel:
    """A model of 40 kHz transducers that all face +z, delays and gains of which are not known to differ.

    Args:
        name: name of its `ArrayKind`.
        position: middle of each transducer's face [m], shape [transducer, 3], as `flat_grid` gives it.
        wire_order: transducer at each place of the wire, shape [transducer].
        frame_bytes, fifo_frames, usb, baud, embedded, calibrated: as in `ArrayModel`.
        frame_clock, frame_clock_reason, divider_max, divider_default, divider_sustained: the same.
        burst_frames, alternates, takes_points: the same.
        focal_zone: None is |x| and |y| up to 0.15 m, z 0.05 to 0.5 m.

    >>> import numpy as np
    >>> from palpate.device import flat_array, flat_grid
    >>> tiny = flat_array("tiny", flat_grid(4, 4, 10e-3), np.arange(16), frame_bytes=32, fifo_frames=64)
    >>> tiny
    ArrayModel('tiny', 16 transducers)
    >>> tiny.update_rate(tiny.divider_default)  # 40 kHz / 4
    10000.0
    """
    count = len(position)
    return ArrayModel(
        name=name,
        position=frozen(np.array(position, np.float32)),
        normal=frozen(np.tile(np.array([0, 0, 1], np.float32), (count, 1))),
        carrier=40e3,
        frame_clock=frame_clock,
        frame_clock_reason=frame_clock_reason,
        divider_min=1,
        divider_max=divider_max,
        divider_default=divider_default,
        divider_sustained=divider_sustained,
        burst_frames=burst_frames,
        alternates=alternates,
        takes_points=takes_points,
        fifo_frames=fifo_frames,
        frame_bytes=frame_bytes,
        wire_order=frozen(np.array(wire_order, np.intp)),
        delay_offset=frozen(np.zeros(count, np.float32)),
        gain=frozen(np.ones(count, np.float32)),
        calibrated=calibrated,
        focal_zone=focal_zone or FocalZone(lateral=0.15, z_min=0.05, z_max=0.5),
        usb=usb,
        embedded=embedded,
        baud=baud,
        pose=frozen(np.array([0, 0, 0, 0, 0, 0, 1.0])),
    )
