"""Load objects, hands and motions from the names and files that the command line takes.

| OBJECT | becomes |
|---|---|
| built-in name, mesh file | MeshObject |
| .npy .npz .nrrd .nhdr .nii .nii.gz .nvdb | VoxelObject |
| .json | ImplicitObject of an expression |
| package.module:function, file.py:function | ImplicitObject of a Warp function |

| --hand | with a motion of poses | with a recording of joints |
|---|---|---|
| palm | a rectangle | the same |
| planes | palm and phalanges of a flat hand | those of the hand recorded, articulated |
| skin | palpate's own hand, flat | palpate's own hand as the joints pose it |
| file of a mesh, volume or expression | a MeshHand of it | the same, rigid |
"""

import zipfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.bounded_file import open_regular
from ...datasets.errors import MotionError, RecordingWarning
from ...datasets.hand_model.shape import hand_shape
from ...datasets.hand_model.skinning import posed_vertices
from ...datasets.known_names import find_name, likely_file, likely_name
from ...datasets.motions.hand_motion import HandMotion
from ...datasets.motions.motion_file import is_pose_table
from ...datasets.motions.suspicious_values import suspicious_directions
from ...datasets.recordings.files import JOINT_SUFFIXES, load_recording
from ...datasets.recordings.recording import HandRecording
from ...datasets.user_warnings import warn_user
from ..errors import PoseError, StrategyError
from ..hands.hand import Hand, Palm
from ..hands.mesh_hand import MeshHand
from ..hands.plane_hand import PlaneHand, flat_hand
from ..motions.explorations.explored import exploration
from ..motions.explorations.options import EXPLORATION_OPTIONS
from ..objects.functions.expression import Expression
from ..objects.functions.implicit_object import ImplicitObject, is_function_name
from ..objects.level_of_detail import Detail, simplify
from ..objects.mesh.placement import Placement
from ..objects.mesh.solid_mesh import MeshObject
from ..objects.solid import Solid
from ..objects.voxels.files import UNITS, is_volume
from ..objects.voxels.grid import KINDS
from ..objects.voxels.voxel_object import VoxelObject
from ..runtime.loading_progress import Watch, unwatched
from ..trust.permission import AllowCode
from ..validation import choose, is_number, value_text

EXPLORATION = "exploration"
HANDS = ("palm", "planes", "skin")
SIDES = ("left", "right")
ORDER = "object, hand, motion, strategy"
HEADER_BYTES = 65536  # first bytes of a CSV, in which its header is searched
SOLID_HAND_STEP = 0.002  # [m]; grid step of the mesh of a hand given as a solid; smaller than any focus


def solid_of(given: Any) -> Solid:
    """An object itself, loaded by its name or file, or made of an expression or a mesh of another library."""
    if isinstance(given, Solid):
        return given
    if isinstance(given, Expression):
        return ImplicitObject(given)
    if isinstance(given, Hand | HandMotion | HandRecording):
        raise StrategyError(f"{value_text(given)} comes after the object: the order is {ORDER}")
    return load_solid(str(given), Placement()) if isinstance(given, str | Path) else MeshObject(given)


def hand_of(given: Hand | str | Path) -> Hand:
    """A hand itself, or by its kind or file."""
    return load_hand(str(given), None) if isinstance(given, str | Path) else given


def hand_and_motion_of(hand: Hand | str | Path, motion: Any, solid: Solid) -> tuple[Hand, HandMotion]:
    """A hand itself, or by its kind or file; a motion itself, poses alone, a file, or the word for an exploration.

    A recording poses hands that have joints, and moves other hands as its palm.
    """
    hand = str(hand) if isinstance(hand, Path) else hand
    if isinstance(hand, HandMotion | HandRecording) or isinstance(motion, Hand):
        raise StrategyError(f"the motion comes after the hand: the order is {ORDER}")
    if motion is None or is_number(motion):
        raise StrategyError(f'the motion must be a HandMotion, poses [pose, 7], a file or "exploration", not {motion}')
    if not isinstance(motion, HandRecording | str | Path):
        return hand_of(hand), motion_of(motion)
    kind = hand if isinstance(hand, str) else "palm"
    if isinstance(motion, HandRecording):
        own, placed = recorded_hand_and_motion(kind, None, motion)
    else:
        options = dict.fromkeys(EXPLORATION_OPTIONS)
        own, placed = load_hand_and_motion(kind, None, str(motion), solid, exploration_options=options)
    return own if isinstance(hand, str) else hand, placed


def motion_of(given: HandMotion | np.ndarray) -> HandMotion:
    """A motion itself, or of poses alone, shape [pose, 7]; raises PoseError or MotionError with the row."""
    if isinstance(given, HandMotion):
        return given
    array = np.asarray(given)
    if array.ndim != 2 or array.shape[1] != 7:
        raise PoseError(
            f"poses must be an array [pose, 7] (x y z, qx qy qz qw), not of shape {array.shape}; "
            "static_pose([x, y, z]) makes one of a position"
        )
    return HandMotion(None, array)


def is_unaligned(motion: Any) -> bool:
    """Whether a motion, as `hand_and_motion_of` takes it, may be a recording in its tracker's frame."""
    if isinstance(motion, str | Path):
        return not is_exploration(str(motion)) and is_recording(str(motion))
    return isinstance(motion, HandRecording)


def load_solid(
    source: str,
    placement: Placement,
    *,
    volume: dict[str, Any] | None = None,
    mesh: dict[str, Any] | None = None,
    bounds: tuple[float, ...] | None = None,
    allow_code: AllowCode = False,
    watch: Watch = unwatched,
) -> Solid:
    """Load an object of any kind, by the table above.

    volume: options of `VoxelObject.load`, mesh: those of `MeshObject.load`; a value of None counts as not given.
    bounds: of a function [m]. allow_code: whether a function's module may run, see `trust.permission`.
    watch: called with the stages of loading a mesh.
    Raises UntrustedCodeError for a function without that permission, MeshError for an object that cannot be loaded,
    StrategyError for options of another kind of object.
    """
    repair = {name: value for name, value in (mesh or {}).items() if value is not None}
    given = {name: value for name, value in (volume or {}).items() if value is not None}
    if is_volume(source):
        refuse_options({"bounds": bounds}, "of a function", source)
        refuse_options(repair, "of a mesh", source)
        require_volume_options(given)
        if is_leap_archive(source):
            raise StrategyError(f"{source}: is a recording of a hand, no object: it is a motion, after the object")
        return VoxelObject.load(source, placement=placement, **given)
    refuse_options(given, "of a volume", source)
    if is_function_name(source) or Path(source).suffix == ".json":
        refuse_options(repair, "of a mesh", source)
        box = None if bounds is None else np.array(bounds).reshape(2, 3)
        return ImplicitObject(source, bounds=box, placement=placement, allow_code=allow_code)
    refuse_options({"bounds": bounds}, "of a function", source)
    if find_name(source, HANDS) is not None and not Path(source).exists():
        raise StrategyError(f"{source} is a hand, not an object: hand={source} is where it belongs")
    if Path(source).is_dir():
        raise StrategyError(f"{source or 'an empty name'} is no object: give a file or a built-in object's name")
    if Path(source).suffix.lower() in (".csv", ".h5", ".hdf5"):
        raise StrategyError(f"{source}: is no object; it may be a motion, which comes after the object")
    return MeshObject.load(source, placement=placement, watch=watch, **repair)


def require_volume_options(given: dict[str, Any]) -> None:
    """Raise StrategyError for options that are wrong for every volume; others are checked with its values."""
    for name, known in (("kind", KINDS), ("unit", tuple(UNITS)), ("inside", ("below", "above"))):
        if name in given:
            given[name] = choose(name, given[name], known)
    spacing = np.asarray(given.get("spacing", 1.0), np.float64)
    if not ((spacing > 0) & (spacing < np.inf)).all():  # a NaN compares false
        raise StrategyError(f"--spacing must be positive lengths in metres, not {given['spacing']}")
    if not np.isfinite(given.get("level", 0.0)):
        raise StrategyError(f"--level must be finite, not {given['level']}")


def refuse_options(options: dict[str, Any], whose: str, source: str) -> None:
    """Raise StrategyError for the first option that is given and not for this kind of object, hand or motion."""
    for name, value in options.items():
        if value is not None:
            raise StrategyError(f"--{name.replace('_', '-')} is {whose}, which {source} is not")


def simplified(solid: Solid, tolerance: float | None) -> tuple[Solid, Detail | None]:
    """Simplify an object within a tolerance [m]; 0: a quarter of the focal width; None: do not simplify."""
    if tolerance is None:
        return solid, None
    if not 0 <= tolerance < np.inf:  # a NaN compares false
        raise StrategyError(f"--simplify must be a length in metres of 0 or more, not {tolerance}")
    if not isinstance(solid, MeshObject):
        raise StrategyError(f"--simplify is of a mesh, which {solid.name} is not")
    simple, detail = simplify(solid, tolerance or None)
    simple.placement, simple.detail = solid.placement, detail.described()
    return simple, detail


def is_exploration(source: str) -> bool:
    """Whether a motion is the word for a synthetic one, in any case."""
    return find_name(source, (EXPLORATION,)) is not None


def is_leap_archive(source: str) -> bool:
    """Whether a file is a recording of Leap's as NumPy arrays, which has the suffix of voxels, too."""
    try:
        with zipfile.ZipFile(source) as archive:
            return source.lower().endswith(".npz") and "palm_position.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def is_recording(source: str) -> bool:
    """Whether a file holds recorded joints of a hand rather than poses of a palm."""
    path = Path(source)
    if path.suffix.lower() in JOINT_SUFFIXES:
        return True
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    with open_regular(path) as file:
        lines = file.read(HEADER_BYTES).decode("utf-8-sig", errors="replace").splitlines()
    return not is_pose_table(lines)


def load_motion(source: str, solid: Solid, options: dict[str, Any], watch: Watch = unwatched) -> HandMotion:
    """Load a motion from a file of poses, or make a synthetic exploration of the object.

    options: of the exploration; None: the default. watch: called with the progress of the exploration.
    """
    given = {name: value for name, value in options.items() if value is not None}
    if is_exploration(source):
        try:
            progress = partial(watch, "exploration")
            return exploration(solid.bounds, **given, progress=progress)
        except MotionError as error:
            raise StrategyError(f"{EXPLORATION}: {error}") from error
    if given:
        raise StrategyError(f"--{next(iter(given))} is for a synthetic exploration, but the motion is {source}")
    if Path(source).suffix.lower() not in (".csv", ".h5", ".hdf5"):
        meant = likely_name(source, (EXPLORATION,)) or ("" if Path(source).exists() else likely_file(source))
        raise StrategyError(
            f"{source}: is no motion{meant}: give the word {EXPLORATION} for a synthetic one, a file of poses (.csv, "
            ".h5, .hdf5), or a recording of a hand (.json, .jsonl, .json.lz, .csv, .npz)"
        )
    motion = HandMotion.load(source)
    if motion.provenance is None:  # not made by palpate
        for sentence in suspicious_directions(motion.pose):
            warn_user(f"{source}: {sentence}", RecordingWarning)
    return motion


def load_hand(kind: str, palm: tuple[float, float] | None, recording: HandRecording | None = None) -> Hand:
    """Load a hand by the table above; a recording, which must be `held`, poses the hands that have joints."""
    kind = find_name(kind, HANDS) or kind
    if kind == "palm":
        return Palm() if palm is None else Palm(*palm)
    if palm is not None:
        raise StrategyError(f"--palm is the size of --hand palm, which {kind} is not")
    if kind == "planes":
        if recording is None:
            return flat_hand()
        return PlaneHand.from_joints(recording.joints_in_hand(), recording.radii(), is_left=recording.is_left)
    if kind == "skin":
        return own_skin(recording)
    if is_volume(kind) or Path(kind).suffix == ".json":  # in the hand's frame
        solid = VoxelObject.load(kind, hand=True) if is_volume(kind) else ImplicitObject(kind, hand=True)
        return MeshHand.from_solid(solid, SOLID_HAND_STEP)
    if not Path(kind).is_file():
        meant = (
            f"; side={kind} chooses among a recording's hands"
            if kind in SIDES
            else likely_name(kind, HANDS) or likely_file(kind)
        )
        raise StrategyError(f"hand must be {', '.join(HANDS)}, or a file, and there is no file {kind!r}{meant}")
    return MeshHand.load(kind)


def own_skin(recording: HandRecording | None = None) -> MeshHand:
    """palpate's own hand mesh: flat, or with the breadth and in the poses of a recording."""
    if recording is None:
        shape = hand_shape()
        return MeshHand(shape.vertices, shape.faces, glabrous=shape.glabrous, name="skin")
    shape = hand_shape(breadth=recording.breadth, is_left=recording.is_left)
    vertices = posed_vertices(shape, recording.joints_in_hand(), recording.radii())
    return MeshHand(vertices, shape.faces, glabrous=shape.glabrous, name="skin")


def load_hand_and_motion(
    kind: str,
    palm: tuple[float, float] | None,
    source: str,
    solid: Solid,
    *,
    exploration_options: dict[str, Any],
    side: str | None = None,
    alignment: Path | None = None,
    watch: Watch = unwatched,
) -> tuple[Hand, HandMotion]:
    """Load a hand and its motion, from poses or from a recording.

    exploration_options: of `EXPLORATION_OPTIONS`, the rate at least; with a recording only the rate, at which it is
    resampled. side, alignment: options of a recording. watch: called with the progress of a synthetic exploration.
    """
    if not is_recording(source):
        refuse_options({"side": side, "alignment": alignment}, "of a recording of a hand", source)
        return load_hand(kind, palm), load_motion(source, solid, exploration_options, watch)
    rate = exploration_options["rate"]
    refuse_options({k: v for k, v in exploration_options.items() if k != "rate"}, "of a synthetic exploration", source)
    return recorded_hand_and_motion(kind, palm, load_recording(source, hand=side, alignment=alignment), rate)


def recorded_hand_and_motion(
    kind: str, palm: tuple[float, float] | None, recording: HandRecording, rate: float | None = None
) -> tuple[Hand, HandMotion]:
    """A hand of a kind as it was recorded, and its motion; rate: at which the recording is resampled [Hz]."""
    kind = find_name(kind, HANDS) or kind
    if kind in ("planes", "skin"):
        recording = recording.held(whole=kind == "skin")
    if rate is not None:
        recording = recording.resampled(rate)
    return load_hand(kind, palm, recording), recording.motion()
