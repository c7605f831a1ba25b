"""Contour files for the tests of exports: most poses without contours, in runs, and the first and last ones, too."""

from itertools import pairwise

import numpy as np
from contour_cases import make_contours, write_file

from palpate.datasets import ContourFile


def mostly_empty(pose_count, *, seed=3, **options):
    """Contours whose polylines lie in about a third of the poses; neither the first nor the last has one."""
    contours = make_contours(max(pose_count // 3, 2), seed=seed, **options)
    owner = np.random.default_rng(seed).integers(1, pose_count - 1, len(contours["polyline_closed"]))
    owner[owner % 50 < 17] = 1  # runs of poses without
    count = np.bincount(np.sort(owner), minlength=pose_count)
    return contours | {"pose_start": np.concatenate([[0], np.cumsum(count)]).astype(np.int64)}


def export_case(path, pose_count=300, **changes):
    """An opened contour file, sealed."""
    options = {name: changes.pop(name) for name in ("intensity", "dwell") if name in changes}
    write_file(path, mostly_empty(pose_count, **options), chunk=max(pose_count // 5, 1), **changes)
    return ContourFile(path)


def polylines_of(file, pose):
    """Polylines of a pose, each of shape [point, 3]."""
    own = file.contours(pose, pose + 1)
    return [own["points"][a:b] for a, b in pairwise(own["polyline_start"])]


def quiet(done, total):
    """Watch nothing."""
