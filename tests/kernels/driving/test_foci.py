"""Frames of focal points, byte by byte, against float64 and against what `struct` reads."""

import struct

import numpy as np
import pytest
import warp as wp
from foci_oracle import in_own_frame, unpacked

from palpate.kernels.driving.foci import focus_board, pack_foci

PLACE = np.array([0.02, -0.01, 0.4, 0.6, 0.0, -0.64, 0.48])  # a quaternion of norm 1
AT_REST = np.array([0.0, 0, 0, 0, 0, 0, 1])


def packed(point, target, amplitude, *, pose, count, device):
    axes = np.array([in_own_frame(axis + pose[:3], pose) for axis in np.eye(3)]).T
    frames = wp.full((len(point), 16 * count), wp.uint8(0xEE), dtype=wp.uint8, device=device)
    pack_foci(
        wp.array(point, dtype=wp.vec3, device=device),
        wp.array(target, dtype=wp.float32, device=device),
        wp.array(amplitude, dtype=wp.float32, device=device),
        focus_board(pose, axes, count),
        out=frames,
    )
    return frames.numpy()


def test_bytes_of_an_array_at_rest_are_those_that_struct_writes(device):
    # 1.5 is 0x3FC00000 in float32: its last byte comes last, as numbers are little-endian
    (frame,) = packed([[[1.5, -0.1, 0.2]]], [[1.0]], [0.25], pose=AT_REST, count=1, device=device)
    assert frame.tobytes() == struct.pack("<4f", 1.5, -0.1, 0.2, 0.25)
    assert frame[:4].tolist() == [0, 0, 0xC0, 0x3F]


@pytest.mark.parametrize("count", [1, 3, 4, 8])
def test_each_point_stands_in_the_frame_of_the_array_rounded_once(count, rng, device):
    point = rng.uniform(-0.3, 0.3, (40, count, 3)).astype(np.float32)
    target = (rng.integers(0, 1 << 16, (40, count)) / (1 << 16)).astype(np.float32)
    amplitude = rng.random(40, np.float32)
    frames = packed(point, target, amplitude, pose=PLACE, count=count, device=device)
    for frame, places, targets, level in zip(frames, point, target, amplitude, strict=True):
        wanted = [
            (*in_own_frame(place, PLACE).astype(np.float32).tolist(), float(np.float32(level * ratio)))
            for place, ratio in zip(places, targets, strict=True)
        ]
        assert unpacked(frame.tobytes(), count) == wanted


def test_points_that_a_frame_has_beyond_those_given_repeat_the_first_in_silence(device):
    (frame,) = packed([[[0.01, 0.02, 0.2]]], [[1.0]], [1.0], pose=AT_REST, count=3, device=device)
    first, *others = unpacked(frame.tobytes(), 3)
    assert first == pytest.approx((0.01, 0.02, 0.2, 1.0))
    assert others == [(*first[:3], 0.0)] * 2


def test_points_beyond_those_of_a_frame_are_left_out(device):
    """Kernels pad points to a few sizes: three are computed as four."""
    point = np.float32([[[0, 0, 0.1], [0, 0, 0.2], [0, 0, 0.3], [0, 0, 0.4]]])
    (frame,) = packed(point, np.float32([[1, 0.5, 0.25, 0]]), [1.0], pose=AT_REST, count=3, device=device)
    assert [(z, level) for _, _, z, level in unpacked(frame.tobytes(), 3)] == [
        (pytest.approx(0.1), 1.0),
        (pytest.approx(0.2), 0.5),
        (pytest.approx(0.3), 0.25),
    ]
