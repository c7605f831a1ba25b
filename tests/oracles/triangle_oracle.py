"""What two triangles have in common, in fractions: the corners of their intersection, which is convex."""

from fractions import Fraction
from itertools import pairwise


def exact(point):
    return tuple(Fraction(x) for x in point)


def less(p, q):
    return tuple(a - b for a, b in zip(p, q, strict=True))


def cross(p, q):
    return (p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0])


def dot(p, q):
    return sum(a * b for a, b in zip(p, q, strict=True))


def between(p, q, share):
    return tuple(a + (b - a) * share for a, b in zip(p, q, strict=True))


def normal(t):
    return cross(less(t[1], t[0]), less(t[2], t[0]))


def sides(t):
    return pairwise((*t, t[0]))


def holds(t, x):
    """Whether a triangle with an area holds a point."""
    n = normal(t)
    return dot(n, less(x, t[0])) == 0 and all(dot(n, cross(less(q, p), less(x, p))) >= 0 for p, q in sides(t))


def through(p, q, t):
    """The point where p-q goes through the plane of a triangle from one side to the other, if it does."""
    n = normal(t)
    before, after = dot(n, less(p, t[0])), dot(n, less(q, t[0]))
    return [between(p, q, before / (before - after))] if before * after < 0 else []


def where_sides_cross(p, q, r, s, n):
    """The point that two segments of a plane with normal n have in common, if they are not parallel and have one."""
    d, e = less(q, p), less(s, r)
    span = dot(n, cross(d, e))
    if span == 0:
        return []
    one, two = dot(n, cross(less(r, p), e)) / span, dot(n, cross(less(r, p), d)) / span
    return [between(p, q, one)] if 0 <= one <= 1 and 0 <= two <= 1 else []


def common_points(s, t):
    """Points of which the intersection of two triangles with an area is the hull, as a set."""
    found = [x for x in s if holds(t, x)] + [x for x in t if holds(s, x)]
    for one, two in ((s, t), (t, s)):
        found += [x for p, q in sides(one) for x in through(p, q, two) if holds(two, x)]
    n = normal(t)
    if all(dot(n, less(x, t[0])) == 0 for x in s):
        found += [x for p, q in sides(s) for r, u in sides(t) for x in where_sides_cross(p, q, r, u, n)]
    return set(found)


def on_segment(p, q, x):
    d, e = less(q, p), less(x, p)
    return cross(d, e) == (0, 0, 0) and 0 <= dot(d, e) <= dot(d, d)


def in_line(corner, one, two):
    """Whether two points lie in the same direction from a corner."""
    d, e = less(one, corner), less(two, corner)
    return cross(d, e) == (0, 0, 0) and dot(d, e) > 0


def triangles_cross(s, t):
    """Whether triangles meet elsewhere than at common corners and edges; their corners are tuples of numbers.

    Those of one plane that only lie side by side along a line from a common corner do not, nor do those without area.
    """
    s, t = [exact(x) for x in s], [exact(x) for x in t]
    if normal(s) == (0, 0, 0) or normal(t) == (0, 0, 0):
        return False
    shared = [x for x in s if x in t]
    found = common_points(s, t)
    if len(shared) == 3:
        return True
    if len(shared) == 2:
        return not all(on_segment(*shared, x) for x in found)
    if len(shared) == 1:
        if cross(normal(s), normal(t)) == (0, 0, 0):
            rest = [x for x in found if x != shared[0]]
            return bool(rest) and not all(in_line(shared[0], rest[0], x) for x in rest)
        return found != set(shared)
    return bool(found)
