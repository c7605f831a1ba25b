"""Objects given as functions: expression trees of primitives, and Warp functions of one's own."""

import hashlib
import json
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from ....kernels.fields.expression_tree import tree_field
from ....kernels.fields.field import Field, probe_points
from ....kernels.fields.user_function import function_field
from ...device_copies import KeepsDeviceCopies
from ...errors import ImplicitError
from ...trust.permission import AllowCode
from ..isosurface import isosurface
from ..mesh.placement import (
    Placement,
    PlacementFields,
    axis_rotation,
    place_text,
    placement_of,
    up_rotation,
    warn_of_place,
)
from .expression import Box, Expression, Transform, load_expression
from .expression_compiler import WHOLE, Frame, compile_expression, expression_bounds
from .user_function import load_function, source_of, takes_double, try_function

OUTLINE = 96  # cells along the longest side of the mesh to look at
FIRST_CELLS = 16  # a side, of the search for an inside
FINEST = 1e-6  # [m]; half the diagonal of its smallest cells
NEEDS_BOUNDS = "a function needs bounds, [lowest, highest] in metres"
CELLS_KEPT = 50_000  # of one pass, the most promising ones


class ImplicitObject(KeepsDeviceCopies):
    """A solid given by a function that is below 0 inside: an expression, or a Warp function of position.

    source: an `Expression`; a JSON file of one; a function decorated with @wp.func, of a wp.vec3 or wp.vec3d [m], that
    gives a float or float64; or the name of one, "package.module:function" or "file.py:function".
    bounds: lowest and highest coordinates [m], own coordinates, shape [2, 3]; what leaves them is cut off there. A
    function needs them, an expression where it has none of its own (a half-space).
    placement, or its fields: as for meshes, about the bounds' box. hand: it is one, in the hand frame, so it may lie
    about the origin.
    allow_code: whether the module that a function's name is of may be run; a function itself needs no permission.

    Warns (PalpateWarning) of a size that suggests millimetres, an object behind the array, and a function cut off.
    Raises UntrustedCodeError for a name whose module nobody has permitted to run (`trust`), ImplicitError for what has
    no inside, no bounds, or, of functions, see `function`.

    >>> from palpate.render import ImplicitObject, render, sphere, static_pose
    >>> ball = ImplicitObject(sphere(0.03), name="ball", at=(0, 0, 0.2))
    >>> ball
    ImplicitObject('ball', 60 x 60 x 60 mm at (0, 0, 0.2) m)
    >>> render(ball, "palm", static_pose([0, 0, 0.2])).length().round(2)  # [m], a circle of radius 0.03
    array([0.19], dtype=float32)
    """

    _fields: dict[str, Field]

    def __init__(
        self,
        source: Any,
        *,
        bounds: np.ndarray | None = None,
        placement: Placement | None = None,
        name: str | None = None,
        hand: bool = False,
        allow_code: AllowCode = False,
        **place: Unpack[PlacementFields],
    ) -> None:
        self.name = name or name_of(source)
        if isinstance(source, str) and is_function_name(source) and bounds is None:  # before its module is run
            raise ImplicitError(f"{self.name}: {NEEDS_BOUNDS}")
        source = resolved(source, allow_code)
        self.placement = placement_of(placement, **place)
        given = None if bounds is None else checked_bounds(bounds, self.name)
        self.expression = source if isinstance(source, Expression) else None
        """The tree, in its own coordinates; None for a function."""
        self.function = None if isinstance(source, Expression) else source
        """The Warp function; None for an expression."""
        self.begin_copies()
        if self.expression is not None:
            self._cut, self._own_bounds = limited(self.expression, given, self.name)
            self._frame = placed_frame(self.placement, self._own_bounds)
            self.bounds = expression_bounds(self._cut, self._frame)
            """Lowest and highest coordinates of the surface [m], array frame, float64 [2, 3]; may be a little wide."""
            self._program = compile_expression(self._cut, self._frame)
            require_inside(self.field_on("cpu"), self.bounds, self.name)
        else:
            if given is None:
                takes_double(self.function, self.name)
                raise ImplicitError(f"{self.name}: {NEEDS_BOUNDS}")
            self._tried = try_function(self.function, given, self.name)
            self._own_bounds, self._frame = given, placed_frame(self.placement, given)
            self.bounds = box_of_box(self._frame, given)
        if not hand:
            self._check_place()

    def __repr__(self) -> str:
        """One line."""
        return f"ImplicitObject({self.name!r}, {place_text(self.bounds)})"

    def _check_place(self) -> None:
        warn_of_place(self.name, self.bounds, "for millimetres use scale=0.001, or fit=0.13", self.placement.at)

    @cached_property
    def identity(self) -> str:
        """SHA-256 over the tree, or the function's own source and where it was found inside; bounds and placement."""
        known = {"bounds": self._own_bounds.tolist(), "placement": asdict(self.placement)}
        if self.expression is not None:
            return sha256(json.dumps({"expression": self._cut.described(), **known}).encode())
        text = json.dumps({"function": source_of(self.function), **known})
        return sha256(text.encode() + np.packbits(self._tried).tobytes())

    def require_closed(self) -> None:
        """Nothing to raise: a function has an inside and an outside everywhere."""

    def field_on(self, device: str) -> Field:
        """The solid as a field on a Warp device, uploaded once; value in metres for an expression."""
        with self._lock:
            if device not in self._fields:
                self._fields[device] = self._made_field(device)
            return self._fields[device]

    def _made_field(self, device: str) -> Field:
        if self.expression is not None:
            return tree_field(self._program, device)
        frame, double = self._frame, takes_double(self.function, self.name)
        return function_field(
            self.function, turn=frame.turn, at=frame.at, scale=frame.scale, bounds=self._own_bounds, double=double
        )

    def outline_mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """A closed mesh of the surface: vertices [m], float32 [vertex, 3], and faces, int32 [face, 3]; made once."""
        return self._outline

    @cached_property
    def _outline(self) -> tuple[np.ndarray, np.ndarray]:
        return isosurface(self, self.bounds, float(np.ptp(self.bounds, axis=0).max()) / OUTLINE)

    def described(self) -> dict[str, Any]:
        """What a file says about the object, for JSON; an expression can be read back from it."""
        if self.expression is not None:
            made = {"representation": "expression", "expression": self.expression.described()}
        else:
            made = {
                "representation": "function",
                "function": name_of(self.function),
                "source": source_of(self.function),
            }
        return {
            "name": self.name,
            **made,
            "bounds": self._own_bounds.tolist(),
            "hash": self.identity,
            "placement": asdict(self.placement),
        }


def sha256(data: bytes) -> str:
    """Hexadecimal SHA-256."""
    return hashlib.sha256(data).hexdigest()


def name_of(source: Any) -> str:
    """What an object is called that was given no name."""
    if isinstance(source, str | Path):
        return str(source).rpartition(":")[2] if is_function_name(source) else Path(source).name
    while isinstance(source, Transform):
        source = source.of[0]
    return source.op if isinstance(source, Expression) else str(getattr(source, "key", "function"))


def is_function_name(source: str | Path) -> bool:
    """Whether it names a function in a module, not a file."""
    return isinstance(source, str) and ":" in source and not Path(source).is_file()


def resolved(source: Any, allow_code: AllowCode = False) -> Any:
    """The expression or function that a path or a name stands for."""
    if not isinstance(source, str | Path):
        return source
    is_function = is_function_name(source)
    return load_function(str(source), allow_code=allow_code) if is_function else load_expression(source)


def checked_bounds(bounds: Any, name: str) -> np.ndarray:
    """Bounds that can be used [m], float64, shape [2, 3]; raises ImplicitError otherwise."""
    try:
        out = np.asarray(bounds, np.float64)
    except (TypeError, ValueError):
        out = np.empty(0)
    if out.shape != (2, 3) or not np.isfinite(out).all() or (out[0] >= out[1]).any():
        raise ImplicitError(f"{name}: bounds must be finite, [lowest, highest] of x, y and z, not {bounds!r:.100}")
    return out


def limited(expression: Expression, given: np.ndarray | None, name: str) -> tuple[Expression, np.ndarray]:
    """The expression, cut by the given bounds if it leaves them, and a box around it [m], own coordinates."""
    own = expression_bounds(expression)
    if given is not None and ((own[0] < given[0]).any() or (own[1] > given[1]).any()):
        expression = expression & Box(tuple(np.ptp(given, axis=0))).moved(*given.mean(axis=0))
        own = expression_bounds(expression)
    if (own[0] > own[1]).any():
        raise ImplicitError(f"{name}: nothing is inside: its parts, or it and its bounds, do not meet")
    if not np.isfinite(own).all():
        axes = ", ".join("xyz"[axis] for axis in range(3) if not np.isfinite(own[:, axis]).all())
        raise ImplicitError(f"{name}: has no end along {axes}: give bounds, or intersect it with something that has")
    return expression, own


def placed_frame(placement: Placement, bounds: np.ndarray) -> Frame:
    """Where own coordinates lie in the array's frame: a placement about the box of the bounds."""
    if placement == Placement():
        return WHOLE
    up = up_rotation(placement.up)
    box = placement.scale * bounds @ up.T
    middle = box.mean(axis=0)
    fit = 1.0 if placement.fit is None else placement.fit / float(np.ptp(box, axis=0).max())
    turn = np.eye(3)
    for axis, angle in enumerate(placement.rotate):
        turn = axis_rotation(axis, np.radians(angle)) @ turn
    target = middle if placement.at is None else np.asarray(placement.at, np.float64)
    return Frame(turn @ up, target - fit * turn @ middle, placement.scale * fit)


def box_of_box(frame: Frame, box: np.ndarray) -> np.ndarray:
    """The box around a box that was put in a frame [m], shape [2, 3]."""
    middle = frame.at + frame.scale * frame.turn @ box.mean(axis=0)
    reach = frame.scale * np.abs(frame.turn) @ np.ptp(box, axis=0) / 2
    return np.stack([middle - reach, middle + reach])


def require_inside(field: Field, bounds: np.ndarray, name: str) -> None:
    """Refuse an expression with nothing inside.

    Its value is never farther from 0 than the surface is, so a cell whose middle has a value above half its diagonal
    is all outside. The others are divided until a point is inside, none are left, or they are too small; of too many
    the ones with the lowest values.
    """
    size = np.ptp(bounds, axis=0) / FIRST_CELLS
    index = np.stack(np.meshgrid(*[np.arange(FIRST_CELLS)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    middle = bounds[0] + (index + 0.5) * size
    halves = np.stack(np.meshgrid(*[[-0.25, 0.25]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    while len(middle):
        value = probe_points(field, middle, device="cpu")
        if (value < 0).any():
            return
        reach = float(np.linalg.norm(size)) / 2
        middle = middle[value <= reach]
        if len(middle) > CELLS_KEPT:
            middle = middle[np.argsort(value[value <= reach], kind="stable")[:CELLS_KEPT]]
        if reach < FINEST:
            raise ImplicitError(
                f"{name}: no inside was found, in steps down to {size.max():.2g} m: is it a mere sheet?"
            )
        middle = (middle[:, None] + halves * size).reshape(-1, 3)
        size = size / 2
    raise ImplicitError(f"{name}: nothing is inside: its parts, or it and its bounds, do not meet")
