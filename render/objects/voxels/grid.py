"""Voxels: what their values mean, where they lie by one affine map, and the box around the surface."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import VoxelError
from ...validation import is_number, value_text
from ..mesh.placement import Placement

LARGEST = float(np.finfo(np.float64).max)
LABEL_LARGEST = 2**64
PADDED_MOST = (2**31 - 1) // 3  # with a layer of outside around them: Warp numbers the three edges of each in an int
KINDS = ("occupancy", "distance", "intensity", "label")
LABELS_NAMED = 20  # labels that an error lists


@dataclass(frozen=True)
class VoxelRule:
    """Which values are inside.

    kind        inside where the value is          surface lies where it is
    occupancy   1                                  half-way between voxel centres
    label       one of `labels`                    half-way between voxel centres
    distance    below `level` (above, if said so)  `level`, interpolated
    intensity   above `level` (below, if said so)  `level`, interpolated
    """

    kind: str
    level: float = 0.0
    """Value on the surface, in the volume's own unit; for distance and intensity."""
    labels: tuple[int, ...] = ()
    inside: str = "below"
    """Side of `level` that is inside: below or above."""
    smooth: float = 0.0
    """Standard deviation of the Gaussian that occupancy and labels are blurred with [m]; 0 leaves them as they are."""


def is_bounded_number(value: object) -> bool:
    """Whether a value is a number of at most LARGEST, positive or negative."""
    return is_number(value) and bool(abs(value) <= LARGEST)


def labels_of(label: object) -> tuple[int, ...]:
    """Labels as whole numbers; raises VoxelError for what is none."""
    given = list(label) if isinstance(label, Sequence | np.ndarray | set | range) and np.ndim(label) == 1 else [label]
    for x in given:
        if not is_bounded_number(x) or x != int(x) or abs(x) >= LABEL_LARGEST:
            raise VoxelError(f"label must be a whole number, or several, not {value_text(x)}")
    if not given:
        raise VoxelError("label must be a whole number, or several, not none at all")
    return tuple(int(x) for x in given)


def rule_of(
    values: np.ndarray,
    kind: str | None,
    *,
    level: float | None,
    label: int | Sequence[int] | None,
    inside: str | None,
    smooth: float,
) -> VoxelRule:
    """What was said about the values, completed; raises VoxelError where it does not go together."""
    if kind is None:
        kind = "label" if label is not None else "intensity" if level is not None else kind_of(values)
    if not isinstance(kind, str) or kind not in KINDS:
        raise VoxelError(f"kind must be one of {', '.join(KINDS)}, not {value_text(kind)}")
    by_level = kind in ("distance", "intensity")
    if (label is not None) != (kind == "label"):
        raise VoxelError(
            f"kind {kind!r} and label {value_text(label)} do not go together: labels need label=..., and only they"
        )
    if not by_level and (level is not None or inside is not None):
        raise VoxelError(f"level and inside are for kinds distance and intensity, not for {kind!r}")
    if kind == "intensity" and level is None:
        raise VoxelError(f"intensities need a level between {values.min():g} and {values.max():g}: level=...")
    if level is not None and not is_bounded_number(level):
        raise VoxelError(f"level must be finite, not {value_text(level)}")
    if inside not in (None, "below", "above"):
        raise VoxelError(f"inside must be 'below' or 'above' the level, not {value_text(inside)}")
    if not is_bounded_number(smooth) or smooth < 0:
        raise VoxelError(f"smooth must be a length in metres of at least 0, not {value_text(smooth)}")
    if smooth and by_level:
        raise VoxelError(f"smooth is for occupancy and labels, not for kind {kind!r}")
    labels = () if label is None else labels_of(label)
    side = inside or ("above" if kind == "intensity" else "below")
    return VoxelRule(kind, float(level or 0.0), labels, side, float(smooth))


def kind_of(values: np.ndarray) -> str:
    """Occupancy if all values are 0 or 1; else it must be said."""
    if values.dtype == bool or (values.dtype.kind in "iu" and values.min() >= 0 and values.max() <= 1):
        return "occupancy"
    raise VoxelError(
        f"values from {values.min():g} to {values.max():g} ({values.dtype}) can mean several things: say "
        "kind='distance' (negative inside), level=... (an intensity), or label=... (of a segmented volume)"
    )


def values_of(values: object) -> np.ndarray:
    """Values as an array; raises VoxelError for masked ones, whose side nothing tells, and for what is no volume."""
    masked = int(np.ma.count_masked(values)) if isinstance(values, np.ma.MaskedArray) else 0
    if masked:
        raise VoxelError(f"{masked} voxels are masked: give them values, as values.filled(...) does")
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise VoxelError(f"values must be [i, j, k] of numbers, not {value_text(values)}") from error
    check_values(array)
    return array


def require_room(shape: Sequence[int]) -> None:
    """Raise VoxelError for a volume that Warp cannot hold, before anything of it is read or allocated.

    shape: voxels along each axis; those beyond the third, which a refusal of their own awaits, count too.
    """
    sizes = [int(size) for size in shape]
    padded = [size + 2 for size in sizes[:3]] + sizes[3:]
    count = math.prod(padded)  # of Python's integers, which do not overflow
    if count <= PADDED_MOST:
        return
    side = int(np.cbrt(PADDED_MOST))
    every = math.ceil((count / PADDED_MOST) ** (1 / 3))
    raise VoxelError(
        f"values must be {PADDED_MOST} at most, a layer around them included (a cube of {side - 2} a side), not "
        f"{count} (shape {sizes}): cut the volume to the object, or keep one voxel in {every} along each axis, "
        f"values[::{every}, ::{every}, ::{every}], with {every} times the spacing"
    )


def check_values(values: np.ndarray) -> None:
    """Refuse what is not a volume of finite numbers, naming what is wrong."""
    if values.ndim != 3:
        choose = ": of a time series or of channels, choose one: VoxelObject(values[..., 0], spacing=METRES)"
        ways = {2: ": a single slice is values[:, :, None]", 4: choose}
        raise VoxelError(f"values must be [i, j, k], not {list(values.shape)}{ways.get(values.ndim, '')}")
    if values.size == 0:
        raise VoxelError(f"values are empty: shape {list(values.shape)}")
    require_room(values.shape)
    if values.dtype.kind not in "biuf":
        raise VoxelError(f"values must be bool, integer or float, not {values.dtype}")
    if values.dtype.kind == "f":
        count, first = 0, None
        for i, layer in enumerate(values):
            bad = ~np.isfinite(layer)
            if bad.any():
                first = first or (i, *(int(x) for x in np.argwhere(bad)[0]))
                count += int(bad.sum())
        if first:
            raise VoxelError(f"{count} voxels are not finite, the first is voxel {list(first)}: {values[first]}")


def signed_values(values: np.ndarray, rule: VoxelRule, affine: np.ndarray) -> np.ndarray:
    """Values that are below 0 inside, float32, layer by layer so that large volumes need little more memory."""
    out = np.empty(values.shape, np.float32)
    for i, layer in enumerate(values):
        if rule.kind == "occupancy":
            if not ((layer == 0) | (layer == 1)).all():
                odd = layer[(layer != 0) & (layer != 1)][0]
                raise VoxelError(f"occupancy must be 0 or 1, but layer {i} has {odd}: give label=... or level=...")
            out[i] = 0.5 - layer.astype(np.float32)
        elif rule.kind == "label":
            out[i] = 0.5
            for label in rule.labels:
                out[i][layer == label] = -0.5
        else:
            with np.errstate(over="ignore"):  # judged below
                above = (layer.astype(np.float64) - rule.level).astype(np.float32)
            out[i] = above if rule.inside == "below" else -above
    if not np.isfinite(out).all():
        raise VoxelError(f"values from {values.min():g} to {values.max():g} are too large for float32")
    if rule.smooth:
        from scipy.ndimage import gaussian_filter  # a tenth of a second that most volumes need not wait for

        sigma = rule.smooth / np.linalg.norm(affine[:3, :3], axis=0)
        if (sigma > values.shape).any():
            size = " x ".join(f"{x:.3g}" for x in values.shape * np.linalg.norm(affine[:3, :3], axis=0))
            raise VoxelError(f"smooth of {rule.smooth:g} m is wider than the volume, {size} m")
        gaussian_filter(out, sigma, output=out, mode="constant", cval=0.5)
    return out


def check_inside(values: np.ndarray, inside: int, rule: VoxelRule) -> None:
    """Refuse a volume without a surface, naming what was looked for."""
    if rule.kind == "label":
        there = np.unique(values)
        missing = [label for label in rule.labels if label not in there]
        if missing:
            names = ", ".join(f"{x:g}" for x in there[:LABELS_NAMED]) + (", ..." if len(there) > LABELS_NAMED else "")
            raise VoxelError(f"label {missing[0]} is not in the volume, which has {names}")
    side = f"{rule.inside} level {rule.level:g}" if rule.kind in ("distance", "intensity") else f"by {rule.kind}"
    if inside == 0 or inside == values.size:
        many = "no voxel is" if inside == 0 else f"all {inside} voxels are"
        raise VoxelError(f"{many} inside ({side}; values run from {values.min():g} to {values.max():g})")


LENGTHS = "one or three positive lengths in metres"
COORDINATES = "three finite coordinates in metres"
DIRECTIONS = "[3, 3] with columns of length 1"
FINEST, COARSEST = 1e-9, 1e6  # [m]; between voxel centres, before a placement
SKEW = 1e-3  # how far from 1 the length of a direction, and from 0 the volume of a cell of unit sides, must be


def numbers_of(name: str, value: object, wanted: str) -> np.ndarray:
    """Numbers as float64, of any shape; raises VoxelError for what is none."""
    try:
        return np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise VoxelError(f"{name} must be {wanted}, not {value_text(value)}") from error


def affine_of(
    spacing: float | Sequence[float] | None,
    origin: Sequence[float] | None,
    direction: np.ndarray | None,
    affine: np.ndarray | None,
) -> np.ndarray:
    """Indices to coordinates [m], shape [4, 4]; raises VoxelError for what is not one."""
    if affine is not None:
        if not (spacing is None and origin is None and direction is None):
            raise VoxelError("give affine, or spacing, origin and direction, not both")
        out = numbers_of("affine", affine, "finite, [4, 4] and end in 0 0 0 1")
        if out.shape != (4, 4) or not np.isfinite(out).all() or (out[3] != [0, 0, 0, 1]).any():
            raise VoxelError(f"affine must be finite, [4, 4] and end in 0 0 0 1, not {value_text(out.tolist())}")
    else:
        step = np.ravel(numbers_of("spacing", 1.0 if spacing is None else spacing, LENGTHS))
        step = np.repeat(step, 3) if len(step) == 1 else step
        if len(step) != 3 or not (np.isfinite(step) & (step > 0)).all():
            raise VoxelError(f"spacing must be {LENGTHS}, not {value_text(spacing)}")
        start = np.zeros(3) if origin is None else numbers_of("origin", origin, COORDINATES)
        if start.shape != (3,) or not np.isfinite(start).all():
            raise VoxelError(f"origin must be {COORDINATES}, not {value_text(origin)}")
        turn = np.eye(3) if direction is None else numbers_of("direction", direction, DIRECTIONS)
        if turn.shape != (3, 3) or not (abs(np.linalg.norm(turn, axis=0) - 1.0) <= SKEW).all():
            raise VoxelError(f"direction must be {DIRECTIONS}, not {value_text(turn.tolist())}")
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = turn * step, start
    axes = out[:3, :3]
    reach = np.abs(axes).max(axis=0)
    if reach.all() and not ((reach >= FINEST) & (reach <= COARSEST)).all():
        raise VoxelError(f"voxels must be {FINEST:g}..{COARSEST:g} m apart, not {value_text(reach.tolist())}")
    if not reach.all() or abs(np.linalg.det(axes / np.linalg.norm(axes, axis=0))) < SKEW:
        raise VoxelError(f"the axes of the volume must not lie in a plane: {value_text(axes.T.tolist())} [m/voxel]")
    return out


def crossing_points(padded: np.ndarray) -> np.ndarray:
    """Where the surface crosses the lines through voxel centres first and last, in indices, float64, shape [point, 3].

    padded: see `pad_outside`; indices are those of what was padded. All other crossings lie between these, so a box
    around them in any direction is the box around all. Works layer by layer: six points a line, whatever the volume.
    """
    out = []
    for axis in range(3):
        other = 0 if axis else 1
        for number, layer in enumerate(np.moveaxis(padded, (other, axis), (0, 1))):
            inside = layer < 0
            change = inside[1:] != inside[:-1]
            column = np.flatnonzero(change.any(axis=0))
            if not len(column):
                continue
            first, last = change.argmax(axis=0)[column], len(change) - 1 - change[::-1].argmax(axis=0)[column]
            for row in (first, last):
                a, b = layer[row, column].astype(np.float64), layer[row + 1, column].astype(np.float64)
                at = np.empty((len(column), 3))
                at[:, other], at[:, 3 - other - axis] = number - 1, column - 1
                at[:, axis] = row - 1 + a / (a - b)
                out.append(at)
    return np.concatenate(out)


def box_of(points: np.ndarray) -> np.ndarray:
    """Lowest and highest coordinates, shape [2, 3]."""
    return np.stack([points.min(axis=0), points.max(axis=0)])


def applied(affine: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points through an affine map."""
    return points @ affine[:3, :3].T + affine[:3, 3]


def corners_of(box: np.ndarray) -> np.ndarray:
    """The eight corners of a box, shape [8, 3]; corner 0 the lowest, then one step along each axis."""
    steps = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]])
    return np.where(steps == 0, box[0], box[1])


def placed_affine(affine: np.ndarray, placement: Placement, points: np.ndarray) -> np.ndarray:
    """The affine map moved as a mesh's vertices are, by the box around the surface; voxels are never resampled.

    points: of the surface, in indices.
    """
    if placement == Placement():
        return affine
    corners = corners_of(box_of(applied(affine, points)))
    after = placement.applied_to(corners)
    move = np.eye(4)
    move[:3, :3] = ((after[1:4] - after[0]) / np.diag(corners[1:4] - corners[0])[:, None]).T
    move[:3, 3] = after[0] - move[:3, :3] @ corners[0]
    return move @ affine


def box_around(affine: np.ndarray, points: np.ndarray) -> np.ndarray:
    """A box that holds the surface [m], shape [2, 3]; the smallest one if the volume's axes are the array's.

    points: where the surface crosses the lines between voxel centres, in indices. It lies within their box there, since
    the trilinear value on a slice of a cell is lowest at a corner; and each of its points within a voxel of one.
    """
    whole = box_of(applied(affine, corners_of(box_of(points))))
    near = box_of(applied(affine, points)) + np.array([[-1.0], [1.0]]) * np.abs(affine[:3, :3]).sum(axis=1)
    return np.stack([np.maximum(whole[0], near[0]), np.minimum(whole[1], near[1])])
