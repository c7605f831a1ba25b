"""Recordings of hands from files of the trackers that people have.

| format         | file                                          | known by                                        |
|----------------|-----------------------------------------------|-------------------------------------------------|
| `leap`         | .json (LeapC's fields), .csv, .npz (leapjs)   | `palm` of a hand; palm_normal_x; the suffix     |
| `leapjs`       | .json, .json.lz of leapjs-playback            | `palmPosition` of a hand; packed frames         |
| `openxr`       | .json, .csv: 26 joints                        | `joints` of a hand; column joint                |
| `webxr`        | the same with 25                              | the same                                        |
| `mediapipe`    | .json, .csv: 21 world landmarks and the wrist | `world_landmarks` of a hand; column landmark    |
| `webxr-static` | .json: named poses without time               | an object of objects of WebXR's joints          |

What is read as .json may be JSON Lines, too (.jsonl, .ndjson): one frame a line.
"""

from os import PathLike
from pathlib import Path
from typing import cast

from ..errors import RecordingError, name_nothing
from ..known_names import likely_file
from .alignment import Alignment, split_alignment
from .clip import Clip, recording_of
from .json_fields import LINE_SUFFIXES, Json, Table, read_json, read_table
from .leap import leap_arrays, leap_json, leap_table
from .leapjs import is_leapjs, leapjs_frames
from .mediapipe import landmarks_json, landmarks_table
from .openxr import joints_json, joints_table, static_poses
from .recording import HandRecording

FORMATS = ("leap", "leapjs", "openxr", "webxr", "mediapipe", "webxr-static")
"""Formats that `load_recording` reads."""

JOINT_SUFFIXES = (".json", *LINE_SUFFIXES, ".lz", ".npz")
"""Suffixes of files that are recordings, whatever they hold; a .csv may be one."""

_SUFFIXES = (*JOINT_SUFFIXES, ".csv")


def load_recording(
    path: str | PathLike[str],
    *,
    format: str | None = None,
    hand: str | int | None = None,
    alignment: Alignment | None = None,
    image_mirrored: bool | None = None,
) -> HandRecording:
    """Read one hand of a recording; docs/formats/recordings.md describes the formats.

    format: leap, leapjs, openxr, webxr, mediapipe or webxr-static; None: as the file states or looks like. hand:
    `left`, `right` or an id; needed only where the file has several. alignment: tracker frame -> array frame (see
    `HandRecording.transformed`), also one that mirrors, as "unity" does; None leaves the tracker's. image_mirrored:
    MediaPipe only; whether it was shown a mirrored image, None: as the file states.

    Raises RecordingError naming the file and, where it can, the frame, line and joint.

    >>> from palpate.datasets import Y_UP, write_sample
    >>> from palpate.render import load_recording
    >>> path = write_sample("webxr", "hand.csv", is_left=True)
    >>> load_recording(path, alignment=Y_UP)
    HandRecording(30 frames of a left hand)
    """
    source = Path(path)
    try:
        frame = None if alignment is None else split_alignment(alignment)
        is_left_handed = frame is not None and frame.mirrors
        clip = _clip(source, format, image_mirrored, is_left_handed=is_left_handed)
        recording = recording_of(clip, hand, is_left_handed=is_left_handed)
    except RecordingError as error:
        refused = RecordingError(f"{source}: {error}")
        raise (name_nothing(refused) if error.names_nothing else refused) from None
    except FileNotFoundError:
        raise name_nothing(RecordingError(f"{source}: no such recording{likely_file(source)}")) from None
    except OSError as error:
        raise RecordingError(f"{source}: cannot be read: {error.strerror or error}") from None
    except MemoryError:
        raise RecordingError(f"{source}: cannot be read: it takes more memory than there is") from None
    return recording if frame is None else recording.transformed(frame.pose)


def _clip(path: Path, name: str | None, image_mirrored: bool | None, *, is_left_handed: bool) -> Clip:
    if name is not None and name not in FORMATS:
        raise RecordingError(f"unknown format {name!r}; known: {', '.join(FORMATS)}")
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise RecordingError(f"unknown suffix {path.suffix!r} for a recording; known: {', '.join(_SUFFIXES)}")
    if suffix == ".npz":
        found, read = "leap", leap_arrays
        if name not in (None, found):
            raise RecordingError(f"a .npz file is read as leap, not as {name}")
        return read(path, is_left_handed=is_left_handed)
    if suffix == ".csv":
        table = read_table(path)
        form = name or _table_format(table)
        if form == "leap":
            return leap_table(table, is_left_handed=is_left_handed)
        if form in ("leapjs", "webxr-static"):
            raise RecordingError(f"{form} is a JSON format")
        return landmarks_table(table, image_mirrored) if form == "mediapipe" else joints_table(table)
    content = read_json(path)
    form = name or _json_format(content)
    if form == "leap":
        return leap_json(content, is_left_handed=is_left_handed)
    if form == "leapjs":
        return leapjs_frames(content, is_left_handed=is_left_handed)
    if form == "mediapipe":
        return landmarks_json(content, image_mirrored)
    return static_poses(content) if form == "webxr-static" else joints_json(content)


def _table_format(table: Table) -> str:
    for column, form in (("palm_normal_x", "leap"), ("landmark", "mediapipe"), ("joint", "openxr")):
        if table.has(column):
            return form
    raise RecordingError(
        f"the header is of no known recording: {', '.join(table.columns[:12])}; poses need time,x,y,z,qx,qy,qz,qw"
    )


def _json_format(content: Json) -> str:
    name: Json = cast("dict[str, Json]", content).get("format") if isinstance(content, dict) else None
    if name is not None:
        if name not in FORMATS:
            raise RecordingError(f"unknown format {name!r}; known: {', '.join(FORMATS)}")
        return str(name)
    if is_leapjs(content):
        return "leapjs"
    for key, form in (("palm", "leap"), ("world_landmarks", "mediapipe"), ("joints", "openxr")):
        if any(isinstance(hand, dict) and key in hand for hand in _hands(content)):
            return form
    poses = list(cast("dict[str, Json]", content).values()) if isinstance(content, dict) else []
    if poses and all(isinstance(pose, dict) and "wrist" in pose for pose in poses):
        return "webxr-static"
    raise RecordingError(f"looks like no known recording; say its format: {', '.join(FORMATS)}")


def _hands(content: Json) -> list[Json]:
    """Hands of the first frames that have any, whatever else a file is."""
    frames: Json = cast("dict[str, Json]", content).get("frames") if isinstance(content, dict) else content
    for frame in cast("list[Json]", frames) if isinstance(frames, list) else []:
        hands: Json = cast("dict[str, Json]", frame).get("hands") if isinstance(frame, dict) else None
        if isinstance(hands, list) and hands:
            return cast("list[Json]", hands)
    return []
