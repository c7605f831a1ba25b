"""Surfaces of fields as meshes: closed, outwards, on the surface, within a budget."""

import numpy as np
import pytest
from expression_oracle import bounded_expressions, value
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from palpate.kernels.fields.expression_tree import tree_field
from palpate.render.errors import MeshError
from palpate.render.objects.functions.expression import box, sphere, torus
from palpate.render.objects.functions.expression_compiler import compile_expression, expression_bounds
from palpate.render.objects.isosurface import MARGIN, isosurface


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def assert_closed(faces):
    """Every edge is passed as often one way as the other."""
    wide = faces.astype(np.int64)
    tail, head = wide.ravel(), np.roll(wide, -1, axis=1).ravel()
    forth, back = np.sort(tail * 2**32 + head), np.sort(head * 2**32 + tail)
    assert (forth == back).all()


def meshed(e, step, device="cpu", bounds=None):
    bounds = expression_bounds(e) if bounds is None else bounds
    return isosurface(tree_field(compile_expression(e), device), np.array(bounds), step, device=device)


@pytest.mark.exhaustive
@given(bounded_expressions, st.floats(0.004, 0.02))
@settings(max_examples=40)
def test_meshes_are_closed_and_on_the_surface(e, step):
    bounds = expression_bounds(e)
    assume((bounds[0] < bounds[1]).all() and np.ptp(bounds, axis=0).max() < 100 * step)
    try:
        vertices, faces = meshed(e, step)
    except MeshError:
        assume(False)
    assert_closed(faces)
    assert len(np.unique(vertices, axis=0)) == len(vertices) == len(np.unique(faces))
    assert volume(vertices, faces) > 0
    assert np.abs(value(e, vertices.astype(np.float64))).max() <= MARGIN * step + 1e-7


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("e", "exact"),
    [
        (sphere(0.05).moved(0.3, -0.2, 0.5), 4 / 3 * np.pi * 0.05**3),
        (torus(0.05, 0.02), 2 * np.pi**2 * 0.05 * 0.02**2),
        (box(0.1, 0.08, 0.06), 0.1 * 0.08 * 0.06),  # its sides lie on the lattice or between
        (box(0.1, 0.1, 0.1) - box(0.05, 0.05, 0.05), 0.1**3 - 0.05**3),
    ],
)
def test_volumes_are_right(e, exact, device):
    vertices, faces = meshed(e, 0.0025, device)
    assert_closed(faces)
    assert len(np.unique(vertices, axis=0)) == len(vertices)
    assert volume(vertices, faces) == pytest.approx(exact, rel=0.01)
    low, high = expression_bounds(e)
    assert (vertices >= low - 1e-6).all()
    assert (vertices <= high + 1e-6).all()
    assert np.ptp(vertices, axis=0) == pytest.approx(high - low, abs=0.0026)


def test_every_device_gives_the_same_mesh(device):
    e = (sphere(0.05) | box(0.1, 0.02, 0.03).turned(10, 20, 30)) - torus(0.04, 0.01)
    vertices, faces = meshed(e, 0.004, device)
    again = meshed(e, 0.004)
    assert (faces == again[1]).all()
    assert np.abs(vertices - again[0]).max() < 1e-7


def test_what_leaves_the_bounds_is_closed_beyond_them():
    vertices, faces = meshed(sphere(0.05), 0.005, bounds=[[-0.02, -0.1, -0.1], [0.1, 0.1, 0.1]])
    assert_closed(faces)
    assert -0.025 - 1e-6 <= vertices[:, 0].min() <= -0.02


@pytest.mark.parametrize(
    ("bounds", "step", "message"),
    [
        ([[-0.1] * 3, [0.1] * 3], 0.0, "step must be a positive length"),
        ([[-0.1] * 3, [0.1] * 3], float("nan"), "step must be a positive length"),
        ([[0.1] * 3, [-0.1] * 3], 0.01, "bounds must be finite, lowest then highest"),
        ([[-np.inf] * 3, [0.1] * 3], 0.01, "bounds must be finite"),
        ([[-0.1] * 3, [0.1] * 3], 0.0005, r"takes 6\.\d+e\+07 cells, of which 16777216 are allowed; a step of .* fits"),
        ([[-0.1] * 3, [0.1] * 3], 1e-9, "cells, of which"),
        ([[-1e-7] * 3, [1e-7] * 3], 1e-15, "takes"),
        ([[999.0] * 3, [999.0001] * 3], 1e-5, "below what float32 resolves"),
        ([[-0.1] * 3, [0.1] * 3], 0.15, "no point of a lattice of 0.15 m is inside"),
    ],
)
def test_bad_input_is_named(bounds, step, message):
    with pytest.raises(MeshError, match=message):
        meshed(sphere(0.04).moved(0.05, 0.05, 0.05), step, bounds=bounds)
