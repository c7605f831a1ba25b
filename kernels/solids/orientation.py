"""On which side of a plane or a line a point lies, decided exactly for float64 coordinates.

A float64 determinant answers where its error bound allows (Shewchuk 1997, "Adaptive Precision Floating-Point
Arithmetic and Fast Robust Geometric Predicates"). Elsewhere every product is written as a sum of float64 numbers
without error, and the sign of the sum of all is that of its largest part. Exact as long as no product of three
coordinates overflows or has parts below 1e-308; modules that use it must be compiled with `EXACT`.
"""

import warp as wp

BOUND_3D = wp.constant(wp.float64(7.771561172376103e-16))  # (7 + 56 e) e with e = 2^-53: Shewchuk's bound A
BOUND_2D = wp.constant(wp.float64(3.3306690738754716e-16))  # (3 + 16 e) e
SPLITTER = wp.constant(wp.float64(134217729.0))  # 2^27 + 1: halves the 53 bits of a number
PARTS_3D = 192  # 6 products of three sums of two numbers, 4 parts each
PARTS_2D = 16


@wp.func
def sum_error(a: wp.float64, b: wp.float64, s: wp.float64):
    """Rounding error of s = a + b."""
    turned = s - a
    restored = s - turned
    return (a - restored) + (b - turned)


@wp.func
def product_error(a: wp.float64, b: wp.float64, p: wp.float64):
    """Rounding error of p = a * b."""
    c = SPLITTER * a
    a_high = c - (c - a)
    a_low = a - a_high
    c = SPLITTER * b
    b_high = c - (c - b)
    b_low = b - b_high
    return a_low * b_low - (((p - a_high * b_high) - a_low * b_high) - a_high * b_low)


@wp.func
def grow(parts: wp.array[wp.float64], count: int, x: wp.float64):
    """Add a number to a sum of parts that do not overlap; returns how many parts it has then."""
    q = x
    n = int(0)
    for i in range(count):
        s = q + parts[i]
        rest = sum_error(q, parts[i], s)
        if rest != wp.float64(0.0):
            parts[n] = rest
            n += 1
        q = s
    if q != wp.float64(0.0):
        parts[n] = q
        n += 1
    return n


@wp.func
def grow_product(parts: wp.array[wp.float64], count: int, x: wp.float64, y: wp.float64):
    """Add x * y without error."""
    n = int(count)
    p = x * y
    if p != wp.float64(0.0):
        n = grow(parts, n, product_error(x, y, p))
        n = grow(parts, n, p)
    return n


@wp.func
def grow_triple(parts: wp.array[wp.float64], count: int, x: wp.vec2d, y: wp.vec2d, z: wp.vec2d):
    """Add (x0 + x1) (y0 + y1) (z0 + z1) without error."""
    n = int(count)
    for i in range(2):
        for j in range(2):
            p = x[i] * y[j]
            rest = product_error(x[i], y[j], p)
            for k in range(2):
                n = grow_product(parts, n, p, z[k])
                n = grow_product(parts, n, rest, z[k])
    return n


@wp.func
def sign_of_parts(parts: wp.array[wp.float64], count: int):
    """Sign of a sum: that of its last part, which is the largest."""
    if count == 0:
        return 0
    return wp.where(parts[count - 1] > wp.float64(0.0), 1, -1)


@wp.func
def split_difference(a: wp.float64, b: wp.float64):
    """The difference a - b as a sum of two numbers, without error."""
    d = a - b
    return wp.vec2d(d, sum_error(a, -b, d))


@wp.func
def plane_side_exact(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    """`plane_side` without a filter."""
    parts = wp.zeros(shape=PARTS_3D, dtype=wp.float64)
    n = int(0)
    for k in range(3):
        i = (k + 1) % 3
        j = (k + 2) % 3
        x = split_difference(a[k], d[k])
        n = grow_triple(parts, n, x, split_difference(b[i], d[i]), split_difference(c[j], d[j]))
        n = grow_triple(parts, n, -x, split_difference(b[j], d[j]), split_difference(c[i], d[i]))
    return sign_of_parts(parts, n)


@wp.func
def plane_side(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    """Side of the plane through a, b, c that d lies on: 1 where a, b, c run clockwise seen from d, -1, or 0 on it."""
    x = a - d
    y = b - d
    z = c - d
    p = y[1] * z[2]
    q = y[2] * z[1]
    det = x[0] * (p - q)
    size = wp.abs(x[0]) * (wp.abs(p) + wp.abs(q))
    p = y[2] * z[0]
    q = y[0] * z[2]
    det += x[1] * (p - q)
    size += wp.abs(x[1]) * (wp.abs(p) + wp.abs(q))
    p = y[0] * z[1]
    q = y[1] * z[0]
    det += x[2] * (p - q)
    size += wp.abs(x[2]) * (wp.abs(p) + wp.abs(q))
    if wp.abs(det) > BOUND_3D * size:
        return wp.where(det > wp.float64(0.0), 1, -1)
    if size == wp.float64(0.0):
        return 0
    return plane_side_exact(a, b, c, d)


@wp.func
def line_side(a: wp.vec2d, b: wp.vec2d, c: wp.vec2d):
    """Side of the line from a to b that c lies on: 1 to its left, -1 to its right, 0 on it."""
    p = (a[0] - c[0]) * (b[1] - c[1])
    q = (a[1] - c[1]) * (b[0] - c[0])
    det = p - q
    if wp.abs(det) > BOUND_2D * (wp.abs(p) + wp.abs(q)):
        return wp.where(det > wp.float64(0.0), 1, -1)
    if p == wp.float64(0.0) and q == wp.float64(0.0):
        return 0
    parts = wp.zeros(shape=PARTS_2D, dtype=wp.float64)
    n = int(0)
    x = split_difference(a[0], c[0])
    y = split_difference(b[1], c[1])
    z = split_difference(a[1], c[1])
    w = split_difference(b[0], c[0])
    for i in range(2):
        for j in range(2):
            n = grow_product(parts, n, x[i], y[j])
            n = grow_product(parts, n, -z[i], w[j])
    return sign_of_parts(parts, n)
