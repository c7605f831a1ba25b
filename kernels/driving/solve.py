"""Several focal points a frame -> delays: naive, GS-PAT (Plasencia et al. 2020), WGS, and GS-PAT then WGS.

Of a frame with points m and transducers n: A_mn is the wave of n at m, T_m the target, p_m the coefficients that are
looked for. Transducer n is driven with x_n = sum_m conj(A_mn) p_m, of which the phase alone is used.

    naive    p = T
    GS-PAT   R = A B, B = A^H / sum_n |A_mn|^2; p <- T y / |y|, y = R p; at last p <- T^2 y / |y|^2, over the same sum
    WGS      P = A x / |x|; w <- w (T / |P|)^e, to a largest of 1; p <- w P / |P|

e is 1, but 1/2 for two points: there the ratio of the pressures answers a ratio of weights near 1 so steeply that e = 1
swings about it (of 60 random frames, median error after 20 iterations 11 %, with 1/2 under 0.01 %; for three and more
points 1 is faster).

A warp works on a frame on CUDA and makes the waves anew in each pass, which costs less than fetching them; on the CPU,
where it is the other way round, one thread keeps them in a table.
"""

import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT
from .wave import (
    LANES,
    TINY,
    Transducers,
    conjugate,
    delay_of,
    direction,
    fill_waves,
    lane_sum,
    magnitude,
    plus_product,
    quotient,
    wave,
)

wp.set_module_options(EXACT)

SIZES = (2, 4, 8)  # points a frame that kernels are made for: loops over points unroll, and points stay in registers
POINTS_MOST = SIZES[-1]
TABLED = 64  # frames of a launch on the CPU: their table of waves stays in the cache


@wp.struct
class Problem:
    """Frames to solve."""

    points: wp.array2d[wp.vec3]  # [m], shape [frame, size]
    target: wp.array2d[wp.float32]  # relative pressure >= 0, one of them > 0; shape [frame, size]
    transducers: Transducers
    gs_pat: int  # iterations of GS-PAT; 0: none
    wgs: int  # iterations of WGS; 0: none


def _solver(size: int):
    """The kernel for `size` points a frame."""
    Foci = wp.types.matrix(shape=(size, 2), dtype=float)  # a complex number of each point
    Points = wp.types.matrix(shape=(size, 3), dtype=float)
    Power = wp.types.vector(length=size, dtype=float)
    Gram = wp.types.matrix(shape=(size * size, 2), dtype=float)

    @wp.func
    def waves(problem: Problem, points: Points, table: wp.array3d[wp.vec2], frame: int, n: int):
        """A_mn of transducer n."""
        a = Foci()
        t = problem.transducers
        position = t.position[n]
        normal = t.normal[n]
        for m in range(size):
            a[m] = wave(points[m] - position, normal, t.per_metre, t.directivity, table, frame % TABLED, n, m)
        return a

    @wp.func
    def drive_of(a: Foci, p: Foci):
        """x_n."""
        x = wp.vec2()
        for m in range(size):
            x = plus_product(x, conjugate(a[m]), p[m])
        return x

    @wp.func
    def start_gs_pat(
        problem: Problem, points: Points, table: wp.array3d[wp.vec2], frame: int, lane: int, lanes: int, p: Foci
    ):
        """Coefficients by GS-PAT: its iterations touch points alone."""
        r = Gram()
        for n in range(lane, problem.transducers.position.shape[0], lanes):
            a = waves(problem, points, table, frame, n)
            for i in range(size):
                for j in range(size):
                    if j >= i:
                        r[i * size + j] = plus_product(r[i * size + j], a[i], conjugate(a[j]))
        power = Power()
        for i in range(size):
            for j in range(size):
                if j >= i:
                    r[i * size + j] = lane_sum(r[i * size + j])
                    r[j * size + i] = conjugate(r[i * size + j])
            power[i] = quotient(1.0, r[i * size + i][0])
        for k in range(problem.gs_pat):
            y = Foci()
            for j in range(size):
                c = p[j] * power[j]
                for i in range(size):
                    y[i] = plus_product(y[i], r[i * size + j], c)
            for i in range(size):
                target = problem.target[frame, i]
                p[i] = target * direction(y[i])
                if k == problem.gs_pat - 1:
                    p[i] = p[i] * (quotient(target, magnitude(y[i]) + TINY) * power[i])
        return p

    @wp.func
    def largest(p: Foci):
        """Greatest magnitude."""
        most = TINY
        for m in range(size):
            most = wp.max(most, magnitude(p[m]))
        return most

    @wp.func
    def reweight(
        problem: Problem, points: Points, table: wp.array3d[wp.vec2], frame: int, lane: int, lanes: int, p: Foci
    ):
        """One iteration of WGS."""
        reached = Foci()
        live = int(0)
        for m in range(size):
            if problem.target[frame, m] > 0.0:
                live += 1
        for n in range(lane, problem.transducers.position.shape[0], lanes):
            a = waves(problem, points, table, frame, n)
            q = direction(drive_of(a, p))
            for m in range(size):
                reached[m] = plus_product(reached[m], a[m], q)
        for m in range(size):
            reached[m] = lane_sum(reached[m])
            ratio = quotient(problem.target[frame, m], magnitude(reached[m]) + TINY)
            if live == 2:
                ratio = wp.sqrt(ratio)
            p[m] = magnitude(p[m]) * ratio * direction(reached[m])
        return p * quotient(1.0, largest(p))

    @wp.kernel
    def _solve_frames(
        problem: Problem,
        first: int,
        lanes: int,
        table: wp.array3d[wp.vec2],  # scratch, shape [TABLED or 0, transducer, size]
        delay: wp.array2d[wp.float32],
    ):
        """Solve one frame with the lanes of a warp: coefficients first, then the delays that they give."""
        frame = first + wp.tid() // lanes
        lane = wp.tid() % lanes
        p = Foci()
        points = Points()
        t = problem.transducers
        for m in range(size):
            p[m] = wp.vec2(problem.target[frame, m], 0.0)
            x = problem.points[frame, m]
            points[m] = x
            fill_waves(x, t.position, t.normal, t.per_metre, t.directivity, frame % TABLED, m, table)
        if problem.gs_pat > 0:
            p = start_gs_pat(problem, points, table, frame, lane, lanes, p)
        p = p * quotient(1.0, largest(p))
        for _ in range(problem.wgs):
            p = reweight(problem, points, table, frame, lane, lanes, p)
        for n in range(lane, t.position.shape[0], lanes):
            delay[frame, n] = delay_of(drive_of(waves(problem, points, table, frame, n), p))

    return _solve_frames


SOLVERS = {size: _solver(size) for size in SIZES}


@on_one_device
def solve_points(points: wp.array, target: wp.array, transducers: Transducers, *, gs_pat: int, wgs: int) -> wp.array:
    """Delays of transducers for several points a frame [turns], 0..1, float32, shape [frame, transducer].

    points: wp.vec3 [m], shape [frame, size], size one of SIZES: the caller pads fewer points with target 0.
    target: relative pressure, float32, the same shape; every frame needs one above 0.
    gs_pat, wgs: iterations of each, one after the other; none of both is naive.
    Raises ValueError for another size.
    """
    frame_count, size = points.shape
    if size not in SOLVERS or target.shape != points.shape:
        raise ValueError(f"points a frame must be one of {SIZES} and as many targets, not {points.shape, target.shape}")
    device, problem, transducer_count = points.device, Problem(), transducers.position.shape[0]
    problem.points, problem.target, problem.transducers = points, target, transducers
    problem.gs_pat, problem.wgs = gs_pat, wgs
    delay = wp.empty((frame_count, transducer_count), dtype=wp.float32, device=device)
    lanes, step = (1, TABLED) if device.is_cpu else (LANES, max(frame_count, 1))
    table = wp.empty((TABLED if device.is_cpu else 0, transducer_count, size), dtype=wp.vec2, device=device)
    for first in range(0, frame_count, step):
        wp.launch(
            SOLVERS[size],
            min(step, frame_count - first) * lanes,
            inputs=[problem, first, lanes],
            outputs=[table, delay],
            device=device,
            block_dim=BLOCK,
        )
    return delay
