"""Expressions made ready for the interpreter: transforms folded into the primitives, operands in a good order, bounds.

Bounds are those of where the value is below a level, which offsets and blends raise on the way down to the leaves: an
offset of d by d, a blend of width w by w/4. The box of a primitive grows by the level.
"""

from dataclasses import dataclass

import numpy as np

from ....kernels.fields import expression_tree
from .expression import (
    Box,
    Capsule,
    Cylinder,
    Difference,
    Expression,
    HalfSpace,
    Intersection,
    Offset,
    SmoothUnion,
    Sphere,
    Torus,
    Transform,
    Union,
)

CODE = {
    Sphere: expression_tree.SPHERE,
    Box: expression_tree.BOX,
    Cylinder: expression_tree.CYLINDER,
    Torus: expression_tree.TORUS,
    Capsule: expression_tree.CAPSULE,
    HalfSpace: expression_tree.HALF_SPACE,
    Union: expression_tree.UNION,
    Intersection: expression_tree.INTERSECTION,
    Difference: expression_tree.DIFFERENCE,
    SmoothUnion: expression_tree.SMOOTH_UNION,
    Offset: expression_tree.OFFSET,
}
EMPTY = np.array([[np.inf] * 3, [-np.inf] * 3])  # the box of nothing


@dataclass(frozen=True)
class Frame:
    """An expression's own coordinates to those of the whole: scaled, turned, moved."""

    turn: np.ndarray
    """Rotation matrix, shape [3, 3]."""
    at: np.ndarray
    """[m], shape [3]."""
    scale: float

    def inner(self, transform: Transform) -> "Frame":
        """The frame of what a transform works on."""
        return Frame(
            self.turn @ rotation_matrix(transform.rotation),
            self.at + self.scale * (self.turn @ np.asarray(transform.at)),
            self.scale * transform.scale,
        )

    def point(self, x: tuple[float, ...]) -> np.ndarray:
        """A point in the frame of the whole."""
        return self.at + self.scale * (self.turn @ np.asarray(x))


WHOLE = Frame(np.eye(3), np.zeros(3), 1.0)


def rotation_matrix(quaternion: tuple[float, ...]) -> np.ndarray:
    """Rotation matrix of a unit quaternion xyzw; quarter turns are exact."""
    x, y, z, w = quaternion
    out = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    whole = np.round(out)
    return np.where(np.abs(out - whole) < 1e-15, whole, out)


def leaf_instruction(leaf: Expression, frame: Frame) -> np.ndarray:
    """A primitive in the frame of the whole, dtype INSTRUCTION, shape [1]."""
    out = np.zeros(1, expression_tree.INSTRUCTION)
    step = out[0]
    step["code"], step["centre"], step["axis"], step["turn"] = CODE[type(leaf)], frame.at, frame.turn[:, 2], np.eye(3)
    match leaf:
        case Sphere():
            step["size"] = leaf.radius, 0.0, 0.0
        case Box():
            step["size"], step["turn"] = np.asarray(leaf.size) / 2, frame.turn.T
        case Cylinder():
            step["size"] = leaf.radius, leaf.height / 2, 0.0
        case Torus():
            step["size"] = leaf.radius, leaf.tube, 0.0
        case Capsule():
            step["size"], step["centre"] = (leaf.radius, 0.0, 0.0), frame.point(leaf.start)
            step["axis"] = frame.point(leaf.stop) - frame.point(leaf.start)
        case HalfSpace():
            step["axis"] = frame.turn @ np.asarray(leaf.normal)
            step["centre"] = frame.at + frame.scale * leaf.distance * step["axis"]
    step["size"] *= frame.scale
    return out


def operator_instruction(code: int, size: float = 0.0) -> np.ndarray:
    """An operator, dtype INSTRUCTION, shape [1]; size: offset or width [m]."""
    out = np.zeros(1, expression_tree.INSTRUCTION)
    out[0]["code"], out[0]["size"][0] = code, size
    return out


def compile_expression(whole: Expression, frame: Frame = WHOLE) -> np.ndarray:
    """An expression, put in a frame, as a program in postfix order, dtype INSTRUCTION, shape [instruction].

    Of two operands the one that needs the deeper stack comes first, so n primitives need log2(n) + 1 places at most.
    """

    def steps(part: Expression, frame: Frame) -> tuple[list[np.ndarray], int]:
        if isinstance(part, Transform):
            return steps(part.of[0], frame.inner(part))
        if not part.parts:
            return [leaf_instruction(part, frame)], 1
        operands = [steps(inner, frame) for inner in part.parts]
        code = CODE[type(part)]
        if isinstance(part, Offset):
            out, need = operands[0]
            return [*out, operator_instruction(code, part.distance * frame.scale)], need
        swapped = expression_tree.DIFFERENCE_SWAPPED if isinstance(part, Difference) else code
        size = part.width * frame.scale if isinstance(part, SmoothUnion) else 0.0
        if isinstance(part, Union | Intersection):
            operands.sort(key=lambda operand: -operand[1])
        out, need = operands[0]
        for other, other_need in operands[1:]:
            if other_need > need:
                out, need = [*other, *out, operator_instruction(swapped, size)], max(other_need, need + 1)
            else:
                out += [*other, operator_instruction(code, size)]
                need = max(need, other_need + 1)
        return out, need

    program = steps(whole, frame)[0]
    out = np.empty(len(program), expression_tree.INSTRUCTION)  # concatenating would pack the fields
    for k, step in enumerate(program):
        out[k] = step[0]
    return out


def leaf_bounds(step: np.ndarray, level: float) -> np.ndarray:
    """Where a primitive's value is below a level: the box around it [m], shape [2, 3]."""
    centre, axis, size = step["centre"], step["axis"], step["size"]
    across = (
        np.sqrt(np.maximum(1 - axis**2, 0))
        if step["code"] in (expression_tree.CYLINDER, expression_tree.TORUS)
        else np.ones(3)
    )
    match step["code"]:
        case expression_tree.SPHERE:
            low, high = centre - size[0], centre + size[0]
        case expression_tree.BOX:
            reach = np.abs(step["turn"].T) @ size
            low, high = centre - reach, centre + reach
        case expression_tree.CYLINDER:
            reach = size[0] * across + size[1] * np.abs(axis)
            low, high = centre - reach, centre + reach
        case expression_tree.TORUS:
            reach = size[0] * across + size[1]
            low, high = centre - reach, centre + reach
        case expression_tree.CAPSULE:
            low, high = np.minimum(centre, centre + axis) - size[0], np.maximum(centre, centre + axis) + size[0]
        case _:
            along = np.abs(axis) > 1 - 1e-15  # only a plane across an axis bounds it there
            low = np.where(along & (axis < 0), centre, -np.inf)
            high = np.where(along & (axis > 0), centre, np.inf)
    return np.stack([low - level, high + level]) if (low - level <= high + level).all() else EMPTY


def expression_bounds(whole: Expression, frame: Frame = WHOLE) -> np.ndarray:
    """A box around the solid in a frame [m], shape [2, 3]: infinite where it has no bounds, `EMPTY` if surely empty."""

    def bounds(part: Expression, frame: Frame, level: float) -> np.ndarray:
        match part:
            case Transform():
                return bounds(part.of[0], frame.inner(part), level)
            case Offset():
                return bounds(part.of[0], frame, level + part.distance * frame.scale)
            case Difference():
                return bounds(part.of[0], frame, level)
            case Union() | SmoothUnion() | Intersection():
                raised = level + (part.width * frame.scale / 4 if isinstance(part, SmoothUnion) else 0.0)
                low, high = np.stack([bounds(inner, frame, raised) for inner in part.of], axis=1)
                if not isinstance(part, Intersection):
                    return np.stack([low.min(axis=0), high.max(axis=0)])
                low, high = low.max(axis=0), high.min(axis=0)
                return np.stack([low, high]) if (low <= high).all() else EMPTY
        return leaf_bounds(leaf_instruction(part, frame)[0], level)

    return bounds(whole, frame, 0.0)
