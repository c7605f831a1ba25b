"""A tree of primitives as a program for a stack machine: one compiled function for every tree.

A program is in postfix order. Transforms are folded into its leaves beforehand, so each leaf is given in the frame of
the whole. Every instruction is 1-Lipschitz (moving x by d [m] changes the value by d at most), so the distance to the
surface is never less than the value's size.

| code | reads | value |
|---|---|---|
| SPHERE | centre, size[0] radius | exact distance |
| BOX | centre, turn (frame -> box), size half sides | exact |
| CYLINDER | centre, axis (unit), size[0] radius, [1] half height | exact |
| TORUS | centre, axis, size[0] ring's radius, [1] tube's | exact |
| CAPSULE | centre one end, axis to the other (not unit), size[0] radius | exact |
| HALF_SPACE | centre on the plane, axis its normal, outwards | exact |
| UNION, INTERSECTION | two values | exact outside, a lower bound inside; the other way round |
| DIFFERENCE, DIFFERENCE_SWAPPED | first less second, second less first | lower bound |
| SMOOTH_UNION | two values, size[0] width of the blend | lower bound |
| OFFSET | one value, size[0] outwards | lower bound |
"""

import numpy as np
import warp as wp

from ..patch import EXACT
from .field import Field, distance_ball

wp.set_module_options(EXACT)

STACK = 16  # values under way at once: enough for any tree of 2^15 leaves, whatever its shape
SPHERE, BOX, CYLINDER, TORUS, CAPSULE, HALF_SPACE = range(6)
UNION, INTERSECTION, DIFFERENCE, DIFFERENCE_SWAPPED, SMOOTH_UNION, OFFSET = range(6, 12)

_SPHERE, _BOX, _CYLINDER = wp.constant(SPHERE), wp.constant(BOX), wp.constant(CYLINDER)
_TORUS, _CAPSULE, _HALF_SPACE = wp.constant(TORUS), wp.constant(CAPSULE), wp.constant(HALF_SPACE)
_UNION, _INTERSECTION, _DIFFERENCE = wp.constant(UNION), wp.constant(INTERSECTION), wp.constant(DIFFERENCE)
_SWAPPED, _SMOOTH_UNION, _OFFSET = wp.constant(DIFFERENCE_SWAPPED), wp.constant(SMOOTH_UNION), wp.constant(OFFSET)
NOUGHT = wp.constant(wp.float64(0.0))

Stack = wp.types.vector(length=STACK, dtype=wp.float64)


@wp.struct
class Instruction:
    """One step of a program; lengths in metres."""

    code: int
    centre: wp.vec3d
    axis: wp.vec3d
    size: wp.vec3d
    turn: wp.mat33d


INSTRUCTION = np.dtype(Instruction.numpy_dtype())
"""An Instruction to NumPy."""


@wp.struct
class Tree:
    """A program on one device."""

    program: wp.array[Instruction]


@wp.func
def box_value(q: wp.vec3d, half: wp.vec3d):
    """Distance to a box about the origin."""
    d = wp.vec3d(wp.abs(q[0]) - half[0], wp.abs(q[1]) - half[1], wp.abs(q[2]) - half[2])
    out = wp.vec3d(wp.max(d[0], NOUGHT), wp.max(d[1], NOUGHT), wp.max(d[2], NOUGHT))
    return wp.length(out) + wp.min(wp.max(d[0], wp.max(d[1], d[2])), NOUGHT)


@wp.func
def leaf_value(step: Instruction, x: wp.vec3d):
    """Distance to a primitive, below 0 inside [m]."""
    q = x - step.centre
    if step.code == _SPHERE:
        return wp.length(q) - step.size[0]
    if step.code == _BOX:
        return box_value(step.turn * q, step.size)
    along = wp.dot(q, step.axis)
    if step.code == _HALF_SPACE:
        return along
    if step.code == _CAPSULE:
        share = wp.clamp(along / wp.dot(step.axis, step.axis), NOUGHT, wp.float64(1.0))
        return wp.length(q - share * step.axis) - step.size[0]
    across = wp.length(q - along * step.axis)
    if step.code == _TORUS:
        return wp.length(wp.vec2d(across - step.size[0], along)) - step.size[1]
    r = across - step.size[0]  # a cylinder, by distances from its lateral surface and from its nearer end
    h = wp.abs(along) - step.size[1]
    outer = wp.vec2d(wp.max(r, NOUGHT), wp.max(h, NOUGHT))
    return wp.length(outer) + wp.min(wp.max(r, h), NOUGHT)


@wp.func
def combine_values(step: Instruction, a: wp.float64, b: wp.float64):
    """Two values as one."""
    if step.code == _UNION:
        return wp.min(a, b)
    if step.code == _INTERSECTION:
        return wp.max(a, b)
    if step.code == _DIFFERENCE:
        return wp.max(a, -b)
    if step.code == _SWAPPED:
        return wp.max(b, -a)
    share = wp.max(step.size[0] - wp.abs(a - b), NOUGHT) / step.size[0]  # the same for a, b and b, a
    return wp.min(a, b) - wp.float64(0.25) * share * share * step.size[0]


@wp.func
def tree_value(data: Tree, x: wp.vec3d):
    """Below 0 inside, 0 on the surface, above 0 outside [m]; never farther from 0 than the surface is from x."""
    stack = Stack()
    top = int(-1)
    last = wp.float64(0.0)  # the topmost value; those below it are on the stack
    for k in range(data.program.shape[0]):
        step = data.program[k]
        if step.code < _UNION:
            if top >= 0:
                stack[top] = last
            last = leaf_value(step, x)
            top += 1
        elif step.code == _OFFSET:
            last = last - step.size[0]
        else:
            top -= 1
            last = combine_values(step, stack[top], last)
    return last


def tree_field(program: np.ndarray, device: str) -> Field:
    """A program on a device, as a field.

    program: dtype INSTRUCTION, shape [instruction]; checked by who made it (`render.program.compile_expression`).
    """
    data = Tree()
    data.program = wp.array(program, dtype=Instruction, device=device)
    return Field(tree_value, Tree, data, ball=distance_ball(tree_value))
