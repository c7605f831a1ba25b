"""Arrays on different devices: host functions refuse them, with the names of both, before a kernel reads them."""

import importlib
import inspect
import pkgutil
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from contour_random import random_batch

from palpate import kernels
from palpate.kernels.contours import Contours
from palpate.kernels.one_device import MixedDevicesError, on_one_device, require_one_device
from palpate.kernels.stages.cut import Parts, cut_contours, divide_segments
from palpate.render.stages.prune import cut_batch

CHECKED = ("acoustics", "driving", "emphasis", "fillings", "metrics", "stages", "tours")  # edges of render/


class OtherDevice:
    """A device that this machine need not have."""

    def __str__(self):
        return "cuda:7"


def elsewhere(array):
    """The array as if it lay on another device: a view, which frees no memory; on a GPU where there is one."""
    if wp.is_cuda_available():
        return wp.clone(array, device="cuda:0")
    view = array.view(array.dtype)
    view.device = OtherDevice()
    return view


@pytest.fixture
def batch(rng):
    return random_batch(rng, 5).to("cpu")


def test_arrays_on_one_device_and_other_arguments_pass(batch):
    parts = divide_segments(batch.struct)
    require_one_device(batch=batch, parts=parts, none=None, share=0.5, name="x", rows=np.zeros(3), many=(parts, [1]))
    require_one_device()


def test_an_array_in_a_struct_a_tuple_or_a_batch_is_found(batch):
    parts = divide_segments(batch.struct)
    far = Parts()
    far.start, far.segment, far.share = parts.start, parts.segment, elsewhere(parts.share)
    for name, value in (  # a struct, a list and a batch
        ("it", elsewhere(batch.kind)),
        ("it.share", far),
        (r"it\[1\].share", [parts, far]),
        ("it.kind", replace(batch, kind=elsewhere(batch.kind))),
    ):
        with pytest.raises(MixedDevicesError, match=rf"points is on cpu, {name} is on cuda:\d"):
            require_one_device(points=batch.points, it=value)


def test_arrays_without_elements_may_lie_anywhere(batch):
    require_one_device(points=batch.points, none=elsewhere(wp.empty(0, dtype=float, device="cpu")))


def test_the_decorator_names_positional_and_named_arguments(batch):
    @on_one_device
    def together(a, b, *, c=None):
        """Both."""
        return a, b, c

    assert together.__doc__ == "Both."
    assert together(batch.kind, 2, c=3) == (batch.kind, 2, 3)
    far = elsewhere(batch.kind)
    for arguments, named in (((batch.kind, far), {}), ((batch.kind, 1), {"c": far})):
        with pytest.raises(MixedDevicesError, match=f"a is on cpu, {'c' if named else 'b'} is on"):
            together(*arguments, **named)


def test_cutting_refuses_a_keep_on_another_device(batch):
    keep = elsewhere(wp.ones(batch.point_count, dtype=wp.uint8, device="cpu"))
    with pytest.raises(MixedDevicesError, match=r"batch.points is on cpu, keep is on cuda:\d.*wp.clone\(keep, device="):
        cut_batch(batch, keep)
    with pytest.raises(MixedDevicesError, match=r"contours\.points is on cpu, keep is on"):
        cut_contours(batch.struct, keep, divide_segments(batch.struct))


def holds_arrays(annotation):
    """Whether an argument is annotated as an array of Warp's, or as a struct."""
    return isinstance(annotation, type(Contours)) or ("array" in str(annotation) and "ndarray" not in str(annotation))


def test_every_host_function_of_these_rooms_that_takes_several_arrays_checks_them():
    unchecked, count = [], 0
    for room in CHECKED:
        folder = importlib.import_module(f"{kernels.__name__}.{room}")
        for found in pkgutil.iter_modules(folder.__path__, f"{folder.__name__}."):
            module = importlib.import_module(found.name)
            for name, function in inspect.getmembers(module, inspect.isfunction):
                if function.__module__ != module.__name__ or name.startswith("_"):
                    continue
                if sum(holds_arrays(own.annotation) for own in inspect.signature(function).parameters.values()) > 1:
                    count += 1
                    if not hasattr(function, "__wrapped__"):
                        unchecked.append(f"{found.name}.{name}")
    assert unchecked == []
    assert count > 40
