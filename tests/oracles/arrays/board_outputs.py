"""What boards do with the frames that their models record, and where each place of a frame stands, by their makers."""

import numpy as np
from numpy.typing import NDArray


def emulator_slots() -> NDArray[np.float64]:
    """Where the transducer of each slot of a frame stands [m], shape [slot, 3]: the board's own wiring.

    Slots run along columns. The first column is at x = +78.75 mm and starts at y = +78.75 mm, going down; each next
    column is one pitch of 10.5 mm nearer to -x and runs the other way.
    """
    position: list[tuple[float, float, float]] = []
    for column in range(16):
        ascending = [-78.75e-3 + 10.5e-3 * step for step in range(16)]
        path = ascending if column % 2 else ascending[::-1]
        position += [(78.75e-3 - 10.5e-3 * column, y, 0.0) for y in path]
    return np.array(position)


def emulator_drives(frames: NDArray[np.uint8]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What the transducers do in frames of shape [frame, 512].

    Returns:
        Delay [turns] and relative pressure amplitude 0..1, each of shape [frame, slot], slots as in `emulator_slots`.
    """
    return frames[:, 0::2] / 256, frames[:, 1::2] / 255


def pat_pulses(frames: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """What the pins do in frames of shape [frame, 512].

    Returns:
        When the pulse of each pin begins [1/128 turn], and how long it lasts [1/128 turn], each [frame, pin].
    """
    low = frames & np.uint8(0x7F)
    return low[:, :256], low[:, 256:]


def pat_drives(frames: NDArray[np.uint8]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The fundamental of each pin's pulses in frames of shape [frame, 512].

    Returns:
        Delay [turns], 0..1, of the middle of the pulse (a full pulse's is 1/4 turn after its beginning), and pressure
        amplitude relative to a duty of one half, sin(pi duty / 128); each [frame, pin].
    """
    begin, duty = pat_pulses(frames)
    return (begin / 128 + duty / 256) % 1.0, np.sin(np.pi * duty / 128)


def sonic_slots() -> NDArray[np.float64]:
    """Where the transducer of each place of a pattern stands [m], shape [place, 3]: the board's own wiring.

    As the maker lists it in axes of its own: x, y out of the face, z; taken as right-handed, which the list does not
    say, so that its z is -y here. Blocks of 64 places are four columns wide, from -x to +x; in a block, groups of
    eight places are two rows, from -y to +y. In a group, the first row has places 0, 7, 1, 2 from -x to +x, the second
    4, 3, 6, 5.
    """
    edge, pitch = 78.75e-3, 10.5e-3
    column_in_group = (0, 2, 3, 1, 0, 3, 2, 1)
    row_in_group = (0, 0, 0, 1, 1, 1, 1, 0)
    position: list[tuple[float, float, float]] = []
    for place in range(256):
        column = 4 * (place // 64) + column_in_group[place % 8]
        row = 2 * (place % 64 // 8) + row_in_group[place % 8]
        position.append((column * pitch - edge, row * pitch - edge, 0.0))
    return np.array(position)


def sonic_drives(patterns: NDArray[np.uint8]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The fundamental of each transducer's pulses in patterns of shape [pattern, 256].

    Returns:
        Delay [turns], 0..1, of the middle of the half-period pulse, which is 1/4 turn after its beginning, and relative
        pressure amplitude, 0 or 1; each [pattern, place], places as in `sonic_slots`.
    """
    return (patterns / 32 + 0.25) % 1.0, (patterns < 32).astype(np.float64)
