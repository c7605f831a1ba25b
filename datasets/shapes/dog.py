"""The coarse dog: a cage of rings, each extruded from the face before it, cut into 136 triangles.

Modelled with the nose towards -x, z up, feet at 0, in units of about a centimetre; the right side has y > 0, the left
mirrors it. A loop lists a face's corners counter-clockwise seen from outside.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float, float]
Loop = tuple[int, ...]

# Rings of the trunk, rump first: edge of the back, edge of the belly, middle of the belly.
TRUNK: tuple[tuple[Point, Point, Point], ...] = (
    ((4.1, 1.15, 7.4), (4.35, 1.7, 5.4), (4.2, 0.0, 5.1)),
    ((1.6, 1.4, 7.3), (1.8, 1.75, 5.3), (1.9, 0.0, 5.2)),
    ((-1.4, 1.5, 7.45), (-1.6, 2.0, 4.7), (-1.5, 0.0, 4.2)),
    ((-3.5, 1.3, 7.9), (-3.7, 1.75, 5.2), (-3.6, 0.0, 4.6)),
)
# Rings of the right legs by section of the trunk, from there down: outer back, inner back, inner front, outer front.
LEGS: dict[int, tuple[tuple[Point, Point, Point, Point], ...]] = {
    0: (
        ((4.85, 1.75, 2.5), (4.85, 0.75, 2.5), (3.4, 0.7, 2.8), (3.4, 1.8, 2.8)),
        ((4.3, 1.75, 0.0), (4.3, 0.7, 0.0), (2.8, 0.65, 0.0), (2.8, 1.8, 0.0)),
    ),
    2: (((-2.1, 1.75, 0.0), (-2.1, 0.65, 0.0), (-3.6, 0.65, 0.0), (-3.6, 1.8, 0.0)),),
}
# Rings of tail and head from the trunk out: upper and lower corner of the right side.
TAIL: tuple[tuple[Point, Point], ...] = (((4.9, 0.5, 7.5), (5.25, 0.5, 6.6)),)
HEAD: tuple[tuple[Point, Point], ...] = (
    ((-3.9, 0.95, 10.4), (-4.9, 0.95, 8.5)),  # nape and throat
    ((-5.3, 1.15, 10.8), (-5.7, 1.0, 8.3)),  # brow and jaw
    ((-6.1, 0.75, 9.8), (-6.3, 0.7, 8.25)),  # the stop, where the snout begins
    ((-7.9, 0.6, 9.4), (-7.75, 0.5, 8.45)),  # nose
)
NECK, SKULL = 0, 1  # sections of the head: the breast bone stands out of the one, the ears out of the other
TAIL_TIP: Point = (6.3, 0.0, 10.4)
NOSE_TIP: Point = (-8.15, 0.0, 9.1)
BREAST_BONE: Point = (-4.8, 0.0, 6.4)
CROWN: Point = (-4.6, 0.0, 10.7)
EAR_TIP: Point = (-4.2, 1.35, 12.5)


def dog_tips() -> NDArray[np.float64]:
    """Pointed ends of the dog in its own frame: nose, ears, tail; shape [4, 3]."""
    return np.array([NOSE_TIP, EAR_TIP, _mirror(EAR_TIP), TAIL_TIP])


def dog_cage() -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """The coarse dog: vertices, shape [70, 3], and triangles, shape [136, 3], outwards; one shell."""
    cage = _Cage()
    rings = [cage.ring([back, belly, middle, _mirror(belly), _mirror(back)]) for back, belly, middle in TRUNK]
    for section, (behind, ahead) in enumerate(pairwise(rings)):
        sides = cage.sides(behind, ahead)
        for index, side in enumerate(sides):
            if section in LEGS and index in (1, 2):  # the belly's right and left half
                leg = LEGS[section]
                if index == 2:  # the left one: mirroring turns the loop round, so outer and inner corners change places
                    leg = tuple((_mirror(b), _mirror(a), _mirror(d), _mirror(c)) for a, b, c, d in leg)
                cage.face(cage.extrude(side, leg))
            else:
                cage.face(side)
    back_left, belly_left, middle, belly_right, back_right = rings[0][::-1]
    cage.face((belly_left, middle, belly_right))
    tail = cage.extrude((back_left, belly_left, belly_right, back_right), [_mirror_ring(ring)[::-1] for ring in TAIL])
    cage.fan(tail, TAIL_TIP)
    back_right, belly_right, middle, belly_left, back_left = rings[-1]
    cage.face((belly_right, middle, belly_left))
    _add_head(cage, (back_right, belly_right, belly_left, back_left))
    return np.array(cage.points), np.array(cage.triangles, dtype=np.int32)


def _add_head(cage: "_Cage", base: Loop) -> None:
    for section, ring in enumerate(HEAD):
        loop = cage.ring(_mirror_ring(ring))
        sides = cage.sides(base, loop)
        for index, side in enumerate(sides):
            if section == NECK and index == 1:
                cage.fan(side, BREAST_BONE)
            elif section == SKULL and index == 3:
                _add_ears(cage, side)
            else:
                cage.face(side)
        base = loop
    cage.fan(base, NOSE_TIP)


def _add_ears(cage: "_Cage", top: Loop) -> None:
    back_left, back_right, front_right, front_left = top
    crown = cage.ring([CROWN])[0]
    cage.face((back_left, back_right, crown))
    cage.face((front_right, front_left, crown))
    cage.fan((back_right, front_right, crown), EAR_TIP)
    cage.fan((front_left, back_left, crown), _mirror(EAR_TIP))


def _mirror(point: Point) -> Point:
    return point[0], -point[1], point[2]


def _mirror_ring(ring: tuple[Point, Point]) -> list[Point]:
    upper, lower = ring
    return [upper, lower, _mirror(lower), _mirror(upper)]


class _Cage:
    """Points and triangles of a mesh that grows by extrusion."""

    def __init__(self) -> None:
        self.points: list[Point] = []
        self.triangles: list[Loop] = []

    def ring(self, points: "list[Point] | tuple[Point, ...]") -> Loop:
        first = len(self.points)
        self.points.extend(points)
        return tuple(range(first, len(self.points)))

    def sides(self, base: Loop, ring: Loop) -> list[Loop]:
        """The quads between the loop of a missing face and the ring that it moved to."""
        corner = range(len(base))
        return [(base[i], base[i - len(base) + 1], ring[i - len(base) + 1], ring[i]) for i in corner]

    def extrude(self, base: Loop, rings: "list[list[Point]] | tuple[tuple[Point, ...], ...]") -> Loop:
        """Move the missing face along rings, closing the sides; returns the missing face's new loop."""
        for points in rings:
            ring = self.ring(points)
            for side in self.sides(base, ring):
                self.face(side)
            base = ring
        return base

    def face(self, loop: Loop) -> None:
        """Close a missing face of three or four corners, a quad along its shorter diagonal."""
        if len(loop) == 4:
            a, b, c, d = loop
            if self._length(a, c) <= self._length(b, d):
                self.triangles += [(a, b, c), (a, c, d)]
            else:
                self.triangles += [(a, b, d), (b, c, d)]
        else:
            self.triangles.append(loop)

    def fan(self, loop: Loop, tip: Point) -> None:
        """Close a missing face by triangles that meet in a tip."""
        apex = self.ring([tip])[0]
        self.triangles += [(loop[i - 1], loop[i], apex) for i in range(len(loop))]

    def _length(self, a: int, b: int) -> float:
        return float(np.linalg.norm(np.subtract(self.points[a], self.points[b])))
