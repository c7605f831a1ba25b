"""Volumes to test with."""

import importlib.util

import numpy as np
import pytest

from palpate.render import Placement
from palpate.render.objects.voxels.voxel_object import VoxelObject

TURNED = np.array([[0.0, -0.8, 0.6], [1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
PLACE = Placement(at=(0.0, 0.0, 0.2))


def coordinates(shape):
    return np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij"), axis=-1)


def ball(shape=(22, 20, 24), spacing=(0.004, 0.005, 0.003), radius=0.03):
    """Signed distance to a ball in the middle [m], with the spacing."""
    at = (coordinates(shape) - (np.array(shape) - 1) / 2) * spacing
    return (np.linalg.norm(at, axis=-1) - radius).astype(np.float32)


def balled(values=None, **options):
    options = {"spacing": (0.004, 0.005, 0.003), "placement": PLACE, "kind": "distance", **options}
    return VoxelObject(ball() if values is None else values, **options)


def skipped_unless(module):
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed")
