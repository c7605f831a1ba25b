"""Solids as expressions: primitives, operators and transforms, as data with a JSON form.

`sphere(0.04).moved(0, 0, 0.2) | box(0.1, 0.1, 0.01)` is a tree of frozen dataclasses. Its value at a point [m] is below
0 inside and never farther from 0 than the surface is from the point (a lower bound of the distance); for a primitive
on its own, and where a table below says so, it is the distance.

| operator | Python | value | exact distance |
|---|---|---|---|
| union | a | b | min(a, b) | outside |
| intersection | a & b | max(a, b) | inside |
| difference | a - b | max(a, -b) | nowhere for sure |
| smooth union | a.blended(b, w) | min(a, b) - w/4 (1 - abs(a - b)/w)^2 where abs(a - b) < w | nowhere for sure |
| offset | a.grown(d) | a - d | where a is, outside |
| transform | a.moved(..), .turned(..), .scaled(..) | a at the point taken back, times the scale | where a is |

In JSON every node is an object whose "op" names what it is; the other fields are those of its class, and operators
have their operands in "of". A file holds one node.
"""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ....datasets.bounded_file import read_text
from ....datasets.json_text import parse_json
from ....datasets.known_names import unknown_name
from ...errors import ImplicitError
from ...validation import value_text

Vector = tuple[float, float, float]
UNIT = 1e-14  # a length this near to 1 is 1
LARGEST = 2**15  # primitives of one solid: what the interpreter's stack is sure to hold
DEEPEST = 100  # operators above one another: none of the code that walks a tree need mind its depth
SIZE_RANGE = (1e-7, 1e3)  # [m]; of every length that must be positive
FARTHEST = 1e3  # [m]; of every coordinate


def number(where: str, value: Any, low: float, high: float) -> float:
    """A finite number within a range, or ImplicitError."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not low <= value <= high:
        raise ImplicitError(f"{where} must be a number from {low:g} to {high:g}, not {value_text(value)}")
    return float(value)


def vector(where: str, value: Any, low: float = -FARTHEST, high: float = FARTHEST, count: int = 3) -> tuple[float, ...]:
    """Finite numbers within a range, or ImplicitError."""
    if not isinstance(value, tuple | list | np.ndarray) or len(value) != count:
        raise ImplicitError(f"{where} must be {count} numbers, not {value_text(value)}")
    return tuple(number(where, x, low, high) for x in value)


def unit(where: str, value: Any, count: int = 3) -> tuple[float, ...]:
    """Numbers scaled to length 1 (as they are if they have it), or ImplicitError."""
    x = vector(where, value, count=count)
    length = math.hypot(*x)
    if length < 1e-9:
        raise ImplicitError(f"{where} must not be of length 0: {value_text(value)}")
    return x if abs(length - 1) < UNIT else tuple(c / length for c in x)


@dataclass(frozen=True)
class Expression:
    """A solid; combine with |, & and -, place with moved, turned, scaled, change with grown and blended."""

    op: ClassVar[str] = ""
    depth = 0  # no annotation: not a field, but an operator sets its own
    """Operators above one another."""
    leaf_count = 1
    """Primitives; one that is used twice counts twice."""

    @property
    def parts(self) -> "tuple[Expression, ...]":
        """What an operator works on; none for a primitive."""
        return ()

    def __or__(self, other: "Expression") -> "Expression":
        return union(self, other)

    def __and__(self, other: "Expression") -> "Expression":
        return intersection(self, other)

    def __sub__(self, other: "Expression") -> "Expression":
        return Difference((*(self.parts if type(self) is Difference else (self,)), other))

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Expression":
        """Moved [m]."""
        return Transform((self,), at=(x, y, z))

    def turned(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Expression":
        """Turned about the x, then the y, then the z axis through the origin [degree]."""
        half = np.radians(vector("turned: angles", (x, y, z), -1e6, 1e6)) / 2
        turn = (0.0, 0.0, 0.0, 1.0)
        for axis, angle in enumerate(half):
            one = [0.0, 0.0, 0.0, math.cos(angle)]
            one[axis] = math.sin(angle)
            turn = quaternion_product(one, turn)
        return Transform((self,), rotation=turn)

    def scaled(self, factor: float) -> "Expression":
        """Scaled about the origin by a positive factor."""
        return Transform((self,), scale=factor)

    def grown(self, distance: float) -> "Expression":
        """With everything nearer than a distance [m] added; below 0, with as much taken off inwards."""
        return Offset((self,), distance=distance)

    def blended(self, other: "Expression", width: float) -> "Expression":
        """United with another, the seam filled where the two surfaces are nearer to each other than a width [m]."""
        return SmoothUnion((self, other), width=width)

    def described(self) -> dict[str, Any]:
        """The tree for JSON."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        shown = {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
        if self.parts:
            shown["of"] = [part.described() for part in self.parts]
        return {"op": self.op, **shown}

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _set_size(self, *names: str) -> None:
        self._set(**{name: number(f"{self.op}: {name}", getattr(self, name), *SIZE_RANGE) for name in names})


@dataclass(frozen=True)
class Sphere(Expression):
    """A sphere about the origin."""

    op: ClassVar[str] = "sphere"
    radius: float
    """[m]."""

    def __post_init__(self) -> None:
        self._set_size("radius")


@dataclass(frozen=True)
class Box(Expression):
    """A box about the origin, its sides along the axes."""

    op: ClassVar[str] = "box"
    size: Vector
    """Lengths of its sides along x, y and z [m]."""

    def __post_init__(self) -> None:
        self._set(size=vector("box: size", self.size, *SIZE_RANGE))


@dataclass(frozen=True)
class Cylinder(Expression):
    """A solid cylinder about the z axis, its middle at the origin."""

    op: ClassVar[str] = "cylinder"
    radius: float
    """[m]."""
    height: float
    """Whole height along z [m]."""

    def __post_init__(self) -> None:
        self._set_size("radius", "height")


@dataclass(frozen=True)
class Torus(Expression):
    """A ring about the z axis, its middle at the origin."""

    op: ClassVar[str] = "torus"
    radius: float
    """From the z axis to the middle of the tube [m]."""
    tube: float
    """Radius of the tube [m]."""

    def __post_init__(self) -> None:
        self._set_size("radius", "tube")


@dataclass(frozen=True)
class Capsule(Expression):
    """Everything within a radius of a line: a finger's segment."""

    op: ClassVar[str] = "capsule"
    start: Vector
    """One end of the line [m]."""
    stop: Vector
    """The other [m]."""
    radius: float
    """[m]."""

    def __post_init__(self) -> None:
        self._set_size("radius")
        self._set(start=vector("capsule: start", self.start), stop=vector("capsule: stop", self.stop))
        if math.dist(self.start, self.stop) < SIZE_RANGE[0]:
            raise ImplicitError(f"capsule: start and stop are the same point {self.start}; use a sphere")


@dataclass(frozen=True)
class HalfSpace(Expression):
    """Everything behind a plane. It has no bounds: intersect it, or give bounds to the object."""

    op: ClassVar[str] = "half-space"
    normal: Vector
    """Direction out of the solid; its length does not matter."""
    distance: float = 0.0
    """Of the plane from the origin, along the normal [m]."""

    def __post_init__(self) -> None:
        """Refuse what is no direction."""
        self._set(normal=unit("half-space: normal", self.normal))
        self._set(distance=number("half-space: distance", self.distance, -FARTHEST, FARTHEST))


class Operator(Expression):
    """An expression of others; `of` comes first."""

    of: "tuple[Expression, ...]"
    counts: ClassVar[tuple[int, int | None]] = (1, None)

    @property
    def parts(self) -> "tuple[Expression, ...]":
        """What it works on."""
        return self.of

    def __post_init__(self) -> None:
        """Refuse what are no operands, too few, too many, or too deep."""
        low, high = self.counts
        if not isinstance(self.of, tuple | list) or not all(isinstance(part, Expression) for part in self.of):
            raise ImplicitError(f"{self.op}: works on expressions, not {value_text(self.of)}")
        if len(self.of) < low or (high is not None and len(self.of) > high):
            wanted = f"{low}" if low == high else f"at least {low}" if high is None else f"{low} to {high}"
            raise ImplicitError(f"{self.op}: works on {wanted} expression{'s' * (wanted != '1')}, not {len(self.of)}")
        self._set(of=tuple(self.of), depth=1 + max(part.depth for part in self.of))
        self._set(leaf_count=sum(part.leaf_count for part in self.of))
        if self.depth > DEEPEST:
            raise ImplicitError(f"{self.op}: more than {DEEPEST} operators above one another; put unions side by side")
        if self.leaf_count > LARGEST:
            raise ImplicitError(f"{self.op}: {self.leaf_count} primitives, of which a solid may have {LARGEST}")


@dataclass(frozen=True)
class Union(Operator):
    """What is in any of its parts. Parts must overlap, not touch: a face they share counts as a gap of no width."""

    op: ClassVar[str] = "union"
    of: tuple[Expression, ...]


@dataclass(frozen=True)
class Intersection(Operator):
    """What is in all of its parts."""

    op: ClassVar[str] = "intersection"
    of: tuple[Expression, ...]


@dataclass(frozen=True)
class Difference(Operator):
    """What is in the first part and in none of the others."""

    op: ClassVar[str] = "difference"
    counts: ClassVar[tuple[int, int | None]] = (2, None)
    of: tuple[Expression, ...]


@dataclass(frozen=True)
class SmoothUnion(Operator):
    """Two parts, the seam between them filled: by a quarter of the width at most."""

    op: ClassVar[str] = "smooth union"
    counts: ClassVar[tuple[int, int | None]] = (2, 2)
    of: tuple[Expression, ...]
    width: float
    """Where the distances of the two surfaces differ by less than this, they are blended [m]."""

    def __post_init__(self) -> None:
        """Refuse what is no width."""
        super().__post_init__()
        self._set_size("width")


@dataclass(frozen=True)
class Offset(Operator):
    """A part grown, or shrunk if the distance is negative."""

    op: ClassVar[str] = "offset"
    counts: ClassVar[tuple[int, int | None]] = (1, 1)
    of: tuple[Expression, ...]
    distance: float
    """Outwards [m]."""

    def __post_init__(self) -> None:
        """Refuse what is no distance."""
        super().__post_init__()
        self._set(distance=number("offset: distance", self.distance, -FARTHEST, FARTHEST))


@dataclass(frozen=True)
class Transform(Operator):
    """A part scaled, then rotated, then moved."""

    op: ClassVar[str] = "transform"
    counts: ClassVar[tuple[int, int | None]] = (1, 1)
    of: tuple[Expression, ...]
    at: Vector = (0.0, 0.0, 0.0)
    """Where its origin goes [m]."""
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Quaternion xyzw; its length does not matter."""
    scale: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what cannot be applied."""
        super().__post_init__()
        self._set(at=vector("transform: at", self.at), scale=number("transform: scale", self.scale, 1e-6, 1e6))
        self._set(rotation=unit("transform: rotation", self.rotation, count=4))


def quaternion_product(a: Iterable[float], b: Iterable[float]) -> tuple[float, float, float, float]:
    """The rotation b, then a; xyzw."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _side_by_side(kind: type[Operator], parts: tuple[Expression, ...]) -> tuple[Expression, ...]:
    return tuple(inner for part in parts for inner in (part.parts if type(part) is kind else (part,)))


def sphere(radius: float) -> Expression:
    """A sphere about the origin [m].

    >>> from palpate.render import ImplicitObject, sphere
    >>> ImplicitObject(sphere(0.04), at=(0, 0, 0.2))
    ImplicitObject('sphere', 80 x 80 x 80 mm at (0, 0, 0.2) m)
    """
    return Sphere(radius)


def box(x: float, y: float, z: float) -> Expression:
    """A box about the origin, by the lengths of its sides [m].

    >>> from palpate.render import ImplicitObject, box
    >>> ImplicitObject(box(0.1, 0.06, 0.02), at=(0, 0, 0.2))
    ImplicitObject('box', 100 x 60 x 20 mm at (0, 0, 0.2) m)
    """
    return Box((x, y, z))


def cylinder(radius: float, height: float) -> Expression:
    """A solid cylinder about the z axis, its middle at the origin [m].

    >>> from palpate.render import ImplicitObject, cylinder
    >>> ImplicitObject(cylinder(0.03, 0.1), at=(0, 0, 0.2))
    ImplicitObject('cylinder', 60 x 60 x 100 mm at (0, 0, 0.2) m)
    """
    return Cylinder(radius, height)


def torus(radius: float, tube: float) -> Expression:
    """A ring about the z axis: radius to the middle of its tube, and the tube's own [m].

    Where the tube is wider than the radius, it crosses the axis, and values near there, inside, are smaller than the
    distance to the surface.

    >>> from palpate.render import ImplicitObject, torus
    >>> ImplicitObject(torus(0.05, 0.01), at=(0, 0, 0.2))
    ImplicitObject('torus', 120 x 120 x 20 mm at (0, 0, 0.2) m)
    """
    return Torus(radius, tube)


def capsule(start: Vector, stop: Vector, radius: float) -> Expression:
    """Everything within a radius of the line between two points [m].

    >>> from palpate.render import ImplicitObject, capsule
    >>> ImplicitObject(capsule((0, 0, -0.05), (0, 0, 0.05), 0.02), at=(0, 0, 0.2))
    ImplicitObject('capsule', 40 x 40 x 140 mm at (0, 0, 0.2) m)
    """
    return Capsule(start, stop, radius)


def half_space(normal: Vector, distance: float = 0.0) -> Expression:
    """Everything behind the plane at a distance from the origin along its normal [m].

    >>> from palpate.render import ImplicitObject, half_space, sphere
    >>> ImplicitObject(sphere(0.04) & half_space((0, 0, 1)), name="lower half", at=(0, 0, 0.2))
    ImplicitObject('lower half', 80 x 80 x 40 mm at (0, 0, 0.2) m)
    """
    return HalfSpace(normal, distance)


def union(*parts: Expression) -> Expression:
    """What is in any of the parts; unions in it are put side by side."""
    return Union(_side_by_side(Union, parts))


def intersection(*parts: Expression) -> Expression:
    """What is in all of the parts."""
    return Intersection(_side_by_side(Intersection, parts))


PRIMITIVES = (Sphere, Box, Cylinder, Torus, Capsule, HalfSpace)
OPERATORS = (Union, Intersection, Difference, SmoothUnion, Offset, Transform)
KINDS = {kind.op: kind for kind in (*PRIMITIVES, *OPERATORS)}


def expression_from(described: Any, depth: int = 0) -> Expression:
    """The expression that `Expression.described` tells of.

    Raises ImplicitError for an unknown operator or field, a missing one, a value out of range, and a tree too deep.
    """
    if depth > DEEPEST:
        raise ImplicitError(f"expression: more than {DEEPEST} operators above one another")
    if not isinstance(described, Mapping):
        raise ImplicitError(f'expression: a node must be a JSON object with an "op", not {value_text(described)}')
    op = described.get("op")
    if not isinstance(op, str):
        raise ImplicitError(f"expression: op must be one of {', '.join(KINDS)}, not {value_text(op)}")
    kind = KINDS.get(op)
    if kind is None:
        raise ImplicitError("expression: " + unknown_name("op", op, KINDS))
    known = {field.name: field for field in fields(kind)}
    unknown = sorted(str(name) for name in set(described) - set(known) - {"op"})
    if unknown:
        raise ImplicitError(f"{op}: unknown field {unknown[0]!r:.60}; known: {', '.join(known)}")
    missing = [name for name, field in known.items() if name not in described and field.default is MISSING]
    if missing:
        raise ImplicitError(f"{op}: {missing[0]} is missing; it has {', '.join(known)}")
    values = {name: described[name] for name in known if name in described}
    if "of" in values:
        if not isinstance(values["of"], list | tuple):
            raise ImplicitError(f"{op}: of must be a list of expressions, not {value_text(values['of'])}")
        values["of"] = tuple(expression_from(part, depth + 1) for part in values["of"])
    return kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})


def expression_from_json(text: str) -> Expression:
    """Read an expression's JSON.

    Raises ImplicitError for what is no JSON or no expression.

    >>> from palpate.render import expression_from_json
    >>> expression_from_json('{"op": "sphere", "radius": 0.04}')
    Sphere(radius=0.04)
    """
    try:
        described = parse_json(text, allow_nan=True)
    except ValueError as error:
        raise ImplicitError(f"expression: not JSON ({error})") from error
    return expression_from(described)


def expression_to_json(expression: Expression) -> str:
    """An expression as one line of JSON, which `expression_from_json` reads back to the same tree.

    >>> from palpate.render import box, expression_to_json, sphere
    >>> print(expression_to_json(box(0.1, 0.1, 0.02) - sphere(0.03)))
    {"op": "difference", "of": [{"op": "box", "size": [0.1, 0.1, 0.02]}, {"op": "sphere", "radius": 0.03}]}
    """
    return json.dumps(expression.described())


def load_expression(path: str | Path) -> Expression:
    """Read a file's expression.

    Raises ImplicitError, which names the file, for one that is missing or no expression.

    >>> from pathlib import Path
    >>> from palpate.render import load_expression
    >>> _ = Path("ball.json").write_text('{"op": "sphere", "radius": 0.04}')
    >>> load_expression("ball.json")
    Sphere(radius=0.04)
    """
    path = Path(path)
    try:
        return expression_from_json(read_text(path))
    except (OSError, UnicodeDecodeError) as error:
        raise ImplicitError(f"{path}: cannot be read ({error})") from error
    except ImplicitError as error:
        raise ImplicitError(f"{path}: {error}") from error
