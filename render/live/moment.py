"""What a viewer shows of a live run: the constant scene, and the moment that is drawn now."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ...datasets.counted import counted
from ...datasets.hand_model.cage import BREADTH
from ...datasets.rigid import rotate, unit
from ..contour_batch import ContourBatch
from ..hands.hand import Hand
from ..hands.plane_hand import PlaneHand
from ..hands.stored_hand import HandLook, hand_around
from ..sampling.metrics import FocalPoints
from ..sampling.sampler import NOWHERE
from ..sampling.strategy import SamplingStrategy
from .counts import Durations
from .moment_slot import DRAWING, RESTING, CopiedMoment
from .renderer_process import LiveRendering

TRACKING, HELD, FADED, NO_HAND = "tracking", "held", "faded", "no hand"
HELD_FROM = 0.05  # [s]: a pose so old is no longer followed by the next one of a usual tracker


@dataclass(frozen=True, eq=False)
class LiveScene:
    """What stays the same while one rendering of a live run is drawn: object, hand, strategy.

    >>> from palpate.render import Live
    >>> with Live("cube", strategy="oc") as live:
    ...     scene = live.scene()
    >>> scene
    LiveScene(cube, Palm(width=0.085, length=0.085))
    >>> scene.faces.shape, scene.hand_faces.shape  # triangles of the object, and of a hand around the palm
    ((12, 3), (1312, 3))
    """

    object_name: str
    vertices: np.ndarray
    """Of the object where it was placed [m], float32, shape [vertex, 3]."""
    faces: np.ndarray
    """Triangles of the object, int32, shape [face, 3]."""
    strategy: dict[str, Any]
    """The intersection strategy as a contour file describes it."""
    sampling: SamplingStrategy
    hand: Hand
    hand_vertices: np.ndarray
    """Of the hand's mesh, or of a whole hand around a palm or rigid planes, in the hand's frame [m], float32, shape
    [vertex, 3]; none for planes that move."""
    hand_faces: np.ndarray
    """Triangles of the hand, int32, shape [face, 3]."""
    glabrous: np.ndarray
    """Which of them feel, bool, shape [face]."""
    is_skin: bool
    """The hand's mesh is the skin that is rendered; False: it only shows where the patches' hand is."""

    def __repr__(self) -> str:
        return f"LiveScene({self.object_name}, {self.hand!r})"

    @classmethod
    def of(cls, rendering: LiveRendering) -> "LiveScene":
        """The scene of a rendering."""
        vertices, faces = rendering.solid.outline_mesh()
        hand, described = rendering.hand, rendering.hand.described()
        is_skin = described["kind"] == "mesh"
        mesh = (np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros(0, bool))
        if is_skin:
            arrays = hand.arrays()
            mesh = arrays["skin_vertices"], arrays["skin_faces"], arrays["skin_glabrous"] > 0
        elif hand.pose_count is None:
            palm = [own["width"] for own in described.get("patches", [described]) if own.get("name", "palm") == "palm"]
            shape = hand_around(palm[0] if palm else BREADTH)
            mesh = shape.vertices, shape.faces, shape.glabrous
        return cls(
            object_name=rendering.solid.name,
            vertices=vertices,
            faces=faces,
            strategy=rendering.strategy.described(),
            sampling=rendering.sampling,
            hand=hand,
            hand_vertices=mesh[0],
            hand_faces=mesh[1],
            glabrous=mesh[2],
            is_skin=is_skin,
        )

    @property
    def is_rigid(self) -> bool:
        """The hand has the same shape at all poses: its look at one pose, moved, is that at any other."""
        return self.hand.pose_count is None

    def look(self, hand_pose: np.ndarray, patch_pose: np.ndarray | None = None) -> HandLook:
        """The hand at a pose, shape [7]; patch_pose: of planes that move, shape [patch, 7]."""
        pose, hand = np.asarray(hand_pose, np.float64), self.hand
        vertices = (pose[:3] + rotate(unit(pose[3:]), self.hand_vertices.astype(np.float64))).astype(np.float32)
        if self.is_skin:
            return HandLook(np.zeros((0, 4, 3), np.float32), vertices, True)
        if patch_pose is not None and isinstance(hand, PlaneHand):
            hand = PlaneHand(hand.patches, (), patch_pose[None])
        corners = hand.corners(pose[None])[0]
        there = np.isfinite(corners).all(axis=(1, 2))
        return HandLook(corners[there].astype(np.float32), vertices, False)


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveMoment:
    """What is drawn now in a live run, for people who look: `Live.moment` and `Session.moment` give it.

    >>> from palpate.render import Live
    >>> with Live("cube") as live:
    ...     live.wait(0.5)
    ...     moment = live.moment()
    >>> moment.state
    'tracking'
    >>> moment.scene is live.scene(), len(moment.contours), moment.hand.patches.shape
    (True, 1, (1, 4, 3))
    """

    number: int
    """Increases with each moment that was copied; that of the last one while nothing is drawn."""
    scene: LiveScene
    """What is drawn: another object once the rendering has changed, else the same one as before."""
    state: str
    """`tracking`: poses come. `held`: the last one is more than 50 ms old, or the tracker sees no hand any more; its
    contours are drawn on, and fade. `faded`: nothing is drawn until the next pose comes. `no hand`: no pose has come
    yet, or none was copied yet, or the tracker has said that it sees none, and the last one has faded."""
    time: float
    """When the newest focal point is due, from the run's first one [s]; 0 before the first pose."""
    pose_number: int | None = None
    """The same as long as no other pose is drawn; None without hand."""
    stamp: float | None = None
    """When the hand was at its pose, on the clock of `time.monotonic()` [s]; None without hand."""
    hand_pose: np.ndarray | None = None
    """Hand frame -> array frame: position [m], quaternion xyzw; float32, shape [7]; None without hand."""
    patch_pose: np.ndarray | None = None
    """Patch -> hand frame, of planes that move, float32, shape [patch, 7], NaN for one that is not there; else None."""
    contours: ContourBatch = field(default_factory=lambda: NOWHERE)
    """Of this pose only, on the host; empty without hand."""
    points_left_out: int = 0
    """Points of further polylines that the memory between the processes had no room for; 0 as a rule."""
    focus: FocalPoints = field(default_factory=lambda: _NO_FOCUS)
    """The newest focal points as they are handed to the array, of the last 1/30 s, evenly thinned to 512 at most."""
    latency: Durations
    """From the time stamp of a pose to its first focal point [s], of the last 200 poses."""
    poses: int
    """Poses that were played so far."""
    frames: int
    """Frames that the array took so far."""
    dropped: int
    """Frames that were not played as drawn, so far."""

    def __repr__(self) -> str:
        lines = counted(self.contours.polyline_count, "polyline")
        return f"LiveMoment({self.number}: {self.state} at {self.time:.3f} s, {lines}, latency {self.latency!r})"

    @cached_property
    def hand(self) -> HandLook | None:
        """How the hand looks at this pose, worked out when it is first asked for; None without hand."""
        return None if self.hand_pose is None else self.scene.look(self.hand_pose, self.patch_pose)


def moment_of(
    copied: CopiedMoment | None,
    noted: tuple[int, bool, int],
    scene: LiveScene,
    *,
    hold: float,
    now_ns: int,
    **counts: Any,
) -> LiveMoment | None:
    """The moment for a viewer; None where nothing is drawn.

    copied, noted: as `MomentSlot` gives them. hold: age from which a pose fades [s]. counts: `LiveMoment`'s of the run,
    and its number.
    """
    process_state, is_lost, pose_due_ns = noted
    if process_state == RESTING:
        return None
    age = (now_ns - pose_due_ns) * 1e-9
    state = FADED
    if age < hold + scene.sampling.fade:
        state = TRACKING if age < min(HELD_FROM, hold) and not is_lost else HELD
    elif is_lost:
        state = NO_HAND
    if copied is None or process_state != DRAWING or state == NO_HAND:
        return LiveMoment(scene=scene, state=NO_HAND, time=0.0 if copied is None else copied.time, **counts)
    return LiveMoment(
        scene=scene,
        state=state,
        time=copied.time,
        pose_number=copied.pose.number,
        stamp=copied.pose.stamp_ns * 1e-9,
        hand_pose=copied.pose.pose,
        patch_pose=copied.pose.patch_pose,
        contours=copied.contours,
        points_left_out=copied.points_left_out,
        focus=copied.focus,
        **counts,
    )


_NO_FOCUS = FocalPoints(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
