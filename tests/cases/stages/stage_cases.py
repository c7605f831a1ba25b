"""What tests of stages and of kernels that draw share: batches on which oracles are compared, and limits of points."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from contour_random import bare, degenerate_batch, random_batch, weighted_batch
from transform_cases import a_setting, random_poses, run_stage

from palpate.kernels.offsets import PointLimitError
from palpate.render import MeshObject, Palm, exploration, render


@cache
def real_contours():
    """Closed contours of a tube at the poses of an exploration."""
    tube = MeshObject.load("tube")
    return replace(render(tube, Palm(), exploration(tube, duration=2.0, rate=40.0, seed=2), "cc"), raw_error=None)


def stage_batches(rng):
    """Random, degenerate and real polylines, with intensities and pauses or without; and none, of no pose or some."""
    yield weighted_batch(rng, 30)
    yield bare(random_batch(rng, 30))
    yield degenerate_batch(rng, 100)
    yield degenerate_batch(rng, 100, weighted=False)
    yield random_batch(rng, 0)
    yield random_batch(rng, 3, line_most=0)
    yield real_contours()


def stage_result(name, batch, device, *, limit=None, **options):
    """What a transform stage makes of a batch, whose poses do not matter."""
    setting = a_setting(random_poses(np.random.default_rng(0), batch.pose_count), device=device)
    return run_stage(name, batch, replace(setting, point_limit=limit), **options)


def assert_limited(points_within):
    """A function draws as many points as a limit allows, returns their number, and refuses more with that number."""
    count = points_within(None)
    assert points_within(count) == count > 0
    with pytest.raises(PointLimitError, match=f"{count} points exceed the limit of {count - 1}") as refused:
        points_within(count - 1)
    assert refused.value.count == count
