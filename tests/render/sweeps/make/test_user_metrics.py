"""A user's metrics: NumPy's numbers, the same however poses are batched; bad ones fail alone, and name what came."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import generic_poses

from palpate.render import MeshObject, Palm, closed_contour
from palpate.render.errors import SweepError
from palpate.render.intersection.scene import Scene
from palpate.render.sweeps.make.metrics import UserMetric, measure

SCENE = Scene.of(MeshObject.load("tube"), Palm(), closed_contour())


def metric_of(function):
    return UserMetric("metric 0 f", "mine.py:f", function)


@pytest.fixture(scope="module")
def batch():
    return SCENE.contours(generic_poses(40, 2), 0, "cpu")[0].numpy()


class Strange(BaseException):
    def __str__(self):
        raise ValueError("no words")


@pytest.mark.parametrize("error", [SystemExit(3), KeyboardInterrupt(), Strange(), GeneratorExit()])
def test_whatever_a_function_raises_names_the_metric(batch, error):
    def fail(contours):
        raise error

    with pytest.raises(SweepError, match=rf"metric mine.py:f: raised {type(error).__name__}"):
        metric_of(fail).numbers(batch)


BAD = {
    "text": (lambda contours: "many", r"number per pose, an array of shape \[40\], not str"),
    "texts": (lambda contours: ["many"] * 40, "not list of <U4"),
    "one number": (lambda contours: 3.0, r"not of shape \[\]"),
    "none": (lambda contours: None, "not NoneType of object"),
    "too few": (lambda contours: np.zeros(39), r"not of shape \[39\]"),
    "two axes": (lambda contours: np.zeros((40, 1)), r"not of shape \[40, 1\]"),
    "ragged": (lambda contours: [[1], [1, 2]], "not list"),
    "complex": (lambda contours: np.zeros(40, complex), "complex128"),
    "infinite": (lambda contours: np.full(40, np.inf), "finite or NaN, not inf at pose 0"),
    "nested": (lambda contours: {"a": {"b": np.zeros(40)}}, "as 'a' one number per pose.* not dict"),
    "no key": (lambda contours: {}, "keys of its dict .* not none"),
    "bad key": (lambda contours: {"a b": np.zeros(40)}, "not 'a b'"),
    "number as key": (lambda contours: {1: np.zeros(40)}, "not 1"),
    "raises": (lambda contours: 1 / 0, "raised ZeroDivisionError: division by zero"),
    "exits": (lambda contours: exit(3), "raised SystemExit"),
    "writes": (lambda contours: contours.points.fill(0), "raised ValueError: .*read-only"),
}


ENDLESS = []
ENDLESS.append(ENDLESS)  # a list within itself
BAD["endless"] = (lambda contours: ENDLESS, "not list")


def test_what_is_no_number_per_pose_is_refused_by_name(batch):
    for function, message in BAD.values():
        with pytest.raises(SweepError, match=f"^metric mine.py:f: .*{message}"):
            measure(metric_of(function), batch, 0, 40, None)


@given(values=st.lists(st.floats(-1e6, 1e6) | st.just(math.nan), min_size=40, max_size=40))
@settings(max_examples=20)
def test_nan_does_not_count(values, batch):
    count, total, square, *ends = measure(metric_of(lambda contours: values), batch, 0, 40, None)["stat"][""]
    known = [value for value in values if not math.isnan(value)]
    assert count == len(known)
    assert total == math.fsum(known)
    assert square == pytest.approx(np.square(known).sum(), rel=1e-12)
    assert ends == ([min(known), max(known)] if known else [None, None])
