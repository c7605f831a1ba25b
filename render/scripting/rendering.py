"""`palpate.render.render`: contours in memory that know what they are of."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.motions.hand_motion import HandMotion
from ..contour_batch import array_names
from ..coordinate_spacing import apart_text, warn_of_spacing
from ..hands.hand import Hand
from ..intersection.batch_rendering import collect, removes_any
from ..intersection.job import job_of
from ..intersection.named_inputs import is_unaligned
from ..objects.solid import Solid
from ..strategies.intersection_strategy import IntersectionStrategy
from ..user_warnings import warn_user
from ..validation import require_path
from .rendered_batch import RenderedBatch

LONG = 1.0  # [s]; a motion that goes on so long without a contour is probably elsewhere


def render(
    solid: Solid | str | Path,
    hand: Hand | str,
    motion: HandMotion | np.ndarray | str | Path,
    strategy: IntersectionStrategy | str = "cc",
    *,
    object_pose: HandMotion | np.ndarray | None = None,
    points: str = "array",
    device: str = "cpu",
    devices: Sequence[str] | None = None,
    memory: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> RenderedBatch:
    """Contours of an object on a moving hand, in memory on the host.

    solid: an object, a mesh of trimesh or PyVista, or a name or file that the command line takes. hand: a hand, or
    "palm", "planes", "skin" or a file. motion: a HandMotion, poses alone, shape [pose, 7], a file, or "exploration".
    strategy: an intersection strategy, its name or its JSON file. object_pose: motion or poses of an object that moves,
    [pose, 7]: where the middle of its bounds is, and its rotation.
    points: "array", or "patch" for points relative to the middle of their patch, along its u, v and n, which float32
    holds to 4e-9 m anywhere (`array_points` gives them in the array's frame in float64). devices: one worker on each
    of these Warp devices, by default one on `device`; the contours are the same. memory: budget of what is being
    computed [byte], results apart, by default 512 MB or more. progress: called with the number of poses done.
    Raises MeshError where the strategy needs a closed surface and the object has none; MotionError with the row of a
    bad pose; StrategyError for an unknown device, too small a budget, or points relative to patches of what is not a
    mesh cut by planes, or has stages that need points in the array's frame. Warns of coordinates that float32 does not
    hold to 1e-5 m, and of a second or more without any contour.

    >>> from palpate.render import Palm, render, static_pose
    >>> batch = render("cube", Palm(0.08, 0.1), static_pose([0, 0, 0.2]), "cc")  # the palm is whole inside the cube
    >>> batch
    RenderedBatch(1 pose, 1 with contours, 1 polyline, 5 points, on the host)
    >>> batch.length().round(3)  # round the palm [m]
    array([0.36], dtype=float32)
    """
    is_raw = is_unaligned(motion)
    means = {"device": device, "devices": devices, "memory": memory}
    report = None if progress is None else lambda done, _: progress(done)
    job = job_of(solid, hand, motion, strategy, object_pose=object_pose, points=points, progress=report, **means)
    scene, motion = job.scene, job.motion
    way = '; points="patch" keeps the points themselves exact, but not the poses'
    warn_of_spacing(scene.solid.name, scene.solid.bounds, motion.pose, scene.object_pose, way=way)
    contours, removed = collect(job)
    is_empty = object_pose is None and not contours.point_count and not removes_any(removed)
    if is_empty and (motion.duration or 0.0) >= LONG:
        way = "; give the recording an alignment: load_recording(path, alignment=...)" if is_raw else ""
        warn_user(apart_text(scene.solid.bounds, motion.pose) + way)
    return RenderedBatch(**vars(contours), motion=motion, scene=scene, removed=removed)


def load_contours(path: str | Path) -> RenderedBatch:
    """The contours of a file, all in memory, as a batch that samples, plays, draws and becomes tables.

    `ContourFile` reads parts of a file that is too large. Raises ContourFileError for a file that cannot be read, or is
    not finished.

    >>> from palpate.render import load_contours, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> load_contours(path).sample("stm", duration=0.1)
    SampledContours(1000 focal points at 10000 Hz, 0.1 s, 0 silent, 0 jumps, draw frequency 20.6 Hz)
    """
    require_path(path, "the contour file")
    with ContourFile(path) as file:
        if not file.sealed:
            raise ContourFileError(f'{path}: is not finished; record(..., mode="resume") finishes it')
        arrays = file.contours(0, file.pose_count)
        names = {"object": str(file.object()["name"]), "hand": str(file.hand.get("kind"))}
    given = {name: arrays[name] for name in array_names() if name in arrays}
    return RenderedBatch(**given, motion=HandMotion.load(path), source=Path(path), names=names)
