"""Where object and hand are: far from the array, where float32 tells little apart, or apart from each other."""

import numpy as np

from .user_warnings import warn_user
from .validation import unit_hint

SPACING_MOST = 1e-5  # [m]; what contours are promised to be right to


def warn_of_spacing(name: str, bounds: np.ndarray, *poses: np.ndarray | None, way: str = "") -> None:
    """Warn (PalpateWarning) where float32 steps by more than 1e-5 m: from coordinates of 128 m on.

    name, bounds: of the object, [m], shape [2, 3]; poses: of the hand, and of the object if it moves, shape [pose, 7].
    way: another way out, for the message's end. For functions that scripts call.
    """
    largest = float(np.abs(bounds).max(initial=0.0, where=np.isfinite(bounds)))
    moved = "; at=(0, 0, 0.2) moves the object there" if float(np.spacing(np.float32(largest))) > SPACING_MOST else ""
    for pose in poses:
        if pose is not None and len(pose):  # finite, and without copies: there may be 1e8 of them
            largest = max(largest, float(pose[:, :3].max()), -float(pose[:, :3].min()))
    millimetres = unit_hint(largest, 0.0, 1.0, "m")
    spacing = float(np.spacing(np.float32(largest)))
    if spacing > SPACING_MOST:
        warn_user(
            f"{name}: coordinates reach {largest:.4g} m{millimetres}. There float32 steps by {spacing:.2g} m: poses "
            f"and points are no more exact than that, not {SPACING_MOST:g} m. Move the object and the hand near the "
            f"array's origin{moved}{way}"
        )


def apart_text(bounds: np.ndarray, pose: np.ndarray) -> str:
    """Sentence on poses none of which has a contour: how far object and hand are apart, and where both are.

    Arguments as for `warn_of_spacing`. The distance is from the palms' centres to the object's bounding box.
    """
    centre = pose[:, :3].astype(np.float64)
    low, high = centre.min(axis=0), centre.max(axis=0)
    hint = unit_hint(float(max(-low.min(), high.max())), 0.0, 1.0, "m") if np.abs(bounds).max() < 1.0 else ""
    places = [" ".join(f"{value:.6g}" for value in place) for place in (*bounds, low, high)]
    apart = float(np.linalg.norm(np.maximum(0.0, np.maximum(bounds[0] - centre, centre - bounds[1])), axis=1).min())
    far = f"{apart:.3g} m from it at the nearest" if apart > 0.0 else "within that box"
    return (
        f"no pose has a contour: the object reaches from {places[0]} to {places[1]} m, the palms' centres from "
        f"{places[2]} to {places[3]} m, {far} (a palm whole inside has contours by cc, none by oc){hint}"
    )


def joining_place(pose: np.ndarray) -> str:
    """The middle of the palms' centres [m], as `--at` takes it."""
    middle = (pose[:, :3].min(axis=0) + pose[:, :3].max(axis=0)) / 2.0
    return " ".join(f"{value:.3g}" for value in middle.tolist())
