"""The kernels' stages in a row, arrays in and arrays out: what tests run that must not need `palpate.render`."""

from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest
import warp as wp

from palpate.kernels.contours import measure_contours
from palpate.kernels.patch import ON, Patch
from palpate.kernels.section import search
from palpate.kernels.section.draw import draw_contours
from palpate.kernels.section.half_edges import HalfEdges, upload_surface
from palpate.kernels.section.join import join_sections
from palpate.kernels.section.pieces import CutPlanes

SEARCHES = ("scan", "tree")
STRATEGIES = {"raw": (False, False), "oc": (True, False), "cc": (True, True)}  # whether bounded, whether closed
PALM_AXES = ((1, 0, 0), (0, 0, -1))  # u and v in the hand's frame (design, section 2)
LEVEL_AXES = ((1, 0, 0), (0, 1, 0))
COUNTED = 4e-6  # [m]; shorter polylines are rounding's


@dataclass(frozen=True)
class Drawn:
    """Contours as NumPy arrays; patches of a pose are sections in a row."""

    points: np.ndarray
    kind: np.ndarray
    polyline_start: np.ndarray
    polyline_patch: np.ndarray
    polyline_closed: np.ndarray
    section_start: np.ndarray
    length: np.ndarray  # by kind [m], float32, shape [section, 3]

    def lines_of(self, section):
        """Points of a section's polylines."""
        rows = range(self.section_start[section], self.section_start[section + 1])
        return [self.points[self.polyline_start[k] : self.polyline_start[k + 1]] for k in rows]

    def closed_of(self, section):
        """Whether they are closed, of those that are longer than rounding."""
        first = self.section_start[section]
        long = [k for k, line in enumerate(self.lines_of(section)) if steps_of(line).sum() > COUNTED]
        return [bool(self.polyline_closed[first + k]) for k in long]

    def part(self, first, stop):
        """Sections first..stop, as if they had been drawn alone."""
        lines = slice(self.section_start[first], self.section_start[stop])
        offset = self.polyline_start[lines.start]
        points = slice(offset, self.polyline_start[lines.stop])
        return Drawn(
            self.points[points],
            self.kind[points],
            self.polyline_start[lines.start : lines.stop + 1] - offset,
            self.polyline_patch[lines],
            self.polyline_closed[lines],
            self.section_start[first : stop + 1] - lines.start,
            self.length[first:stop],
        )


def steps_of(line):
    """Lengths of a polyline's segments [m], in float64."""
    return np.linalg.norm(np.diff(line.astype(np.float64), axis=0), axis=1)


def patch_array(halves, device, axes=PALM_AXES, origins=None, *, rim=float(ON)):
    """Patches of a hand: half extents [m], shape [patch, 2]; u and v of all or of each; origins [m] or none.

    rim: how near to a side counts as on it [m]; 0 where numbers meet a side exactly.
    """
    halves = np.atleast_2d(np.asarray(halves, np.float64))
    axes = np.broadcast_to(np.asarray(axes, np.float64), (len(halves), 2, 3))
    origins = np.zeros((len(halves), 3)) if origins is None else np.asarray(origins, np.float64)
    patches = []
    for half, (u, v), origin in zip(halves, axes, origins, strict=True):
        patch = Patch()
        patch.origin = wp.vec3d(*origin)
        patch.u, patch.v, patch.n = wp.vec3d(*u), wp.vec3d(*v), wp.vec3d(*np.cross(u, v))
        patch.half = wp.vec2d(*(half - rim))
        patches.append(patch)
    return wp.array(patches, dtype=Patch, device=device)


def exact_poses(count, seed):
    """Palms around (0, 0, 0.2) m, any way up, the same bits on every machine: no function is called that may differ.

    Quaternions have norms of 0.3 to 1; float32, shape [pose, 7].
    """
    stream, poses = np.random.PCG64(seed), np.zeros((0, 7))
    while len(poses) < count:
        uniform = (
            2.0 * (stream.random_raw(7 * 4 * count).reshape(-1, 7) >> np.uint64(11)).astype(np.float64) * 2.0**-53 - 1.0
        )
        norm = uniform[:, 3] ** 2 + uniform[:, 4] ** 2 + uniform[:, 5] ** 2 + uniform[:, 6] ** 2
        poses = np.concatenate([poses, uniform[(norm > 0.09) & (norm < 1.0)]])
    return (poses[:count] * [0.065, 0.065, 0.065, 1, 1, 1, 1] + [0, 0, 0.2, 0, 0, 0, 0]).astype(np.float32)


def surface_on(mesh, device):
    """Vertices and faces on a device."""
    return upload_surface(HalfEdges(*mesh), device)


@contextmanager
def searching_by(name):
    """Pieces are found by the search of that name, "scan", "tree" or "flat"; None: by the fastest one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "_FORCED_BY_TESTS", name)
        yield


def join(surface, poses, patch, strategy, name, *, limit=None):
    """Joined pieces of a surface at poses [pose, 7] or [pose, patch, 7], found by the search of a name."""
    planes = CutPlanes(surface, pose_array(poses, surface.corner.device), patch, *STRATEGIES[strategy])
    with searching_by(name):
        return join_sections(planes, limit=limit)


def draw(surface, poses, patch, strategy, name, *, limit=None):
    """Contours of a surface on a device at poses [pose, 7] or [pose, patch, 7], every patch, by a strategy's name."""
    return drawn_of(draw_contours(join(surface, poses, patch, strategy, name, limit=limit)))


def pose_array(poses, device):
    """Poses [pose, 7] or [pose, patch, 7] on a device."""
    poses = np.asarray(poses, np.float32)
    poses = poses if poses.ndim == 3 else np.atleast_2d(poses)[:, None]
    return wp.array(poses, dtype=wp.transform, ndim=2, device=device)


def drawn_of(contours):
    """Contours on a device as NumPy arrays, and their lengths."""
    names = ("points", "kind", "polyline_start", "polyline_patch", "polyline_closed", "pose_start")
    return Drawn(*(getattr(contours, name).numpy() for name in names), measure_contours(contours).numpy())


def assert_same_bits(one, two):
    """Two drawings agree in everything, bit by bit."""
    for field in Drawn.__dataclass_fields__:
        a, b = getattr(one, field), getattr(two, field)
        assert a.dtype == b.dtype, field
        np.testing.assert_array_equal(a, b, err_msg=field)  # no NaN, and 0.0 == -0.0 is compared below
        assert a.tobytes() == b.tobytes(), field
