"""Validation of a file's hand: its description against its arrays, and the poses of moving patches."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError
from ..rigid import NORM_TOLERANCE

SKIN = ("skin_vertices", "skin_faces", "skin_glabrous")
ARRAYS_OF_KIND: dict[str, tuple[str, ...]] = {"palm": (), "planes": ("patch_pose",), "mesh": SKIN}
"""Which arrays hands of a kind may have; arrays of other kinds, which newer versions may have, are not validated."""

Arrays = Mapping[str, NDArray[Any]]


def require_hand(hand: Mapping[str, Any], arrays: Arrays, pose_count: int) -> None:
    """Raise ContourFileError where arrays of /hand are not what its description asks for, or not right by themselves.

    arrays: those that are there, by name, of the right dtypes and shapes.
    """
    kind = hand.get("kind")
    if kind in ARRAYS_OF_KIND:
        articulated = "poses" in hand
        wanted = ARRAYS_OF_KIND[kind] if kind != "planes" or articulated else ()
        if odd := sorted(set(arrays) ^ set(wanted)):
            state = "missing" if odd[0] in wanted else "there"
            raise ContourFileError(f"/hand/{odd[0]} is {state}, of a hand of kind {kind!r} as its description tells it")
        if articulated and hand["poses"] != pose_count:
            raise ContourFileError(f"/hand: its description tells {hand['poses']} poses, /motion/pose has {pose_count}")
    there = [name for name in SKIN if name in arrays]
    if 0 < len(there) < len(SKIN):
        raise ContourFileError(f"/hand/{next(n for n in SKIN if n not in there)} is missing, but {there[0]} is there")
    if "patch_pose" in arrays:
        require_quaternions("/hand/patch_pose", arrays["patch_pose"], may_lack=True)
    rows = pose_count if "poses" in hand else 1
    if kind == "planes" and "patch_pose" in arrays:
        _require_rows("patch_pose", arrays, rows, hand.get("patches"), "patches")
    if kind == "mesh":
        _require_rows("skin_vertices", arrays, rows, hand.get("vertices"), "vertices")
        faces = arrays["skin_faces"]
        if faces.size and not (faces.min() >= 0 and faces.max() < hand["vertices"]):
            text = f"/hand/skin_faces points at vertices {faces.min()} to {faces.max()} of {hand['vertices']}"
            raise ContourFileError(text)


def _require_rows(name: str, arrays: Arrays, poses: int, described: object, what: str) -> None:
    """Raise ContourFileError unless an array has as many rows as there are poses times patches or vertices."""
    each = len(cast(Sequence[object], described)) if isinstance(described, list | tuple) else described
    if not isinstance(each, int) or isinstance(each, bool):
        raise ContourFileError(f"/hand: its description does not tell its {what}")
    if len(arrays[name]) != poses * each:
        raise ContourFileError(
            f"/hand/{name} has {len(arrays[name])} rows, expected {poses * each}: {poses} x {each} {what}"
        )


def require_quaternions(path: str, pose: NDArray[Any], *, may_lack: bool = False) -> None:
    """Raise ContourFileError for a pose that is not finite, or whose quaternion's norm is not 1 within 1e-3.

    may_lack: a row that is wholly NaN is right.
    """
    lacks = np.isnan(pose).all(axis=1) & may_lack
    infinite = ~lacks & ~np.isfinite(pose).all(axis=1)
    if infinite.any():
        row = int(np.flatnonzero(infinite)[0])
        raise ContourFileError(f"{path} row {row} is not finite: {pose[row].tolist()}")
    norm = np.sqrt((pose[:, 3:].astype(np.float64) ** 2).sum(axis=1))
    wrong = ~lacks & (np.abs(norm - 1.0) > NORM_TOLERANCE)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise ContourFileError(f"{path} row {row} has quaternion norm {norm[row]:.6g}; it must be 1 within 1e-3")


def hand_problem(hand: Mapping[str, Any], arrays: Arrays) -> str | None:
    """A sentence if the hash in a hand's description is not that of its arrays; None if it is.

    Of poses of patches: SHA-256 of their bytes, each NaN the usual one; of a skin: of vertices, faces and glabrous,
    each followed by "/". Little endian.
    """
    if "sha256" not in hand or hand.get("kind") not in ("planes", "mesh") or not arrays:
        return None
    if hand["kind"] == "planes":
        pose = arrays["patch_pose"]
        digest = hashlib.sha256(np.where(np.isnan(pose), np.float32(np.nan), pose).astype("<f4").tobytes())
    else:
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(arrays[name]).tobytes() + b"/" for name in SKIN))
    return None if digest.hexdigest() == hand["sha256"] else "/hand: sha256 in the description is not of its arrays"
