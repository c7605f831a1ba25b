"""Several hands with motions of their own as one hand, in the frame of the first one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ...datasets.rigid import compose, invert, rotate
from ..errors import PoseError, StrategyError
from .hand import Hand, Palm
from .mesh_hand import MeshHand
from .plane_hand import HandPatch, PatchJoint, PlaneHand

TIME_ROUNDING = 1e-9  # [s]; a clock's end is met by as much
GAP_MOST = 0.1  # [s]; as recorded joints are bridged


def together(
    hands: Sequence[tuple[Hand, HandMotion]],
    *,
    names: Sequence[str] | None = None,
    same_clock: bool = True,
    gap: float = GAP_MOST,
) -> tuple[PlaneHand | MeshHand, HandMotion]:
    """Several hands as one, and the motion of the first.

    hands: palms and hands of planes, which make a PlaneHand with all of their patches, or hand meshes, which make one
    MeshHand; each with its motion. names: what their patches' names begin with, as ("left", "right"); by default "1",
    "2", ... The first hand's times are everyone's: motions of other times are resampled, positions linearly, rotations
    along the shortest way. same_clock: whether their clocks (time + offset) are one, as in one recording; else all
    begin together. gap: between two poses of a motion that are farther apart than this [s], and than twice their median
    interval, there is no hand. A hand that has no pose at a time, since its motion begins later, has a gap or has
    ended, is not there (`PlaneHand.absent`), and nothing is drawn on it; so with a patch that is missing. Motions
    without time go pose by pose, so all need as many.

    Raises StrategyError for no hand, hands that do not go together and names that are not as many; PoseError for
    motions that do not fit or never meet in time, and for a hand mesh that is not there all the time.

    >>> from palpate.render import Palm, static_pose, together
    >>> left, right = (Palm(), static_pose([-0.1, 0, 0.2])), (Palm(), static_pose([0.1, 0, 0.2]))
    >>> hand, motion = together([left, right], names=("left", "right"))
    >>> [patch.name for patch in hand.patches]
    ['left-palm', 'right-palm']
    """
    if not hands:
        raise StrategyError("together needs one hand at least")
    names = [str(k + 1) for k in range(len(hands))] if names is None else list(names)
    if len(names) != len(hands) or len(set(names)) != len(names):
        raise StrategyError(f"together needs a name of its own for each of {len(hands)} hands, not {names}")
    base = hands[0][1]
    times = [Times.of(motion, base, same_clock=same_clock, gap=gap) for _, motion in hands]
    meshes = [(hand, motion) for hand, motion in hands if isinstance(hand, MeshHand)]
    if len(meshes) == len(hands):
        return _mesh_together(meshes, names, times), base
    patches: list[HandPatch] = []
    joints: list[PatchJoint] = []
    pose: list[np.ndarray] = []
    for name, (hand, motion), at in zip(names, hands, times, strict=True):
        planes = planes_of(hand)
        patches += [replace(patch, name=f"{name}-{patch.name}") for patch in planes.patches]
        joints += [replace(j, patch=f"{name}-{j.patch}", other=f"{name}-{j.other}") for j in planes.joints]
        pose.append(_patch_poses(planes, motion, base, name, at))
    return PlaneHand(tuple(patches), tuple(joints), np.concatenate(pose, axis=1)), base


def planes_of(hand: Hand) -> PlaneHand:
    """A hand of planes as it is, a palm as a hand of one plane."""
    if isinstance(hand, PlaneHand):
        return hand
    if isinstance(hand, Palm):
        return PlaneHand((HandPatch("palm", hand.width, hand.length),))
    raise StrategyError(f"together takes palms and hands of planes, or hand meshes alone, not {type(hand).__name__}")


def _patch_poses(hand: PlaneHand, motion: HandMotion, base: HandMotion, name: str, times: "Times") -> np.ndarray:
    """Poses of a hand's patches in the frame of the first hand, at its times; float64, shape [pose, patch, 7]."""
    require_fitting(hand, motion, base, name)
    if hand.patch_pose is None:
        own = np.array([[patch.pose for patch in hand.patches]])
    else:
        own = hand.patch_pose.astype(np.float64)
    if motion is base:
        return np.broadcast_to(own, (len(base), hand.patch_count, 7))
    own = own if len(own) == 1 else times.poses(own)
    return compose(invert(base.pose)[:, None], compose(times.poses(motion.pose[:, None]), own))


def _mesh_together(
    hands: Sequence[tuple[MeshHand, HandMotion]], names: Sequence[str], times: list["Times"]
) -> MeshHand:
    """Hand meshes as one, with vertices for each pose of the first one's motion."""
    base = hands[0][1]
    vertices, faces, glabrous, count = [], [], [], 0
    for name, (hand, motion), at in zip(names, hands, times, strict=True):
        require_fitting(hand, motion, base, name)
        own = hand.vertices if len(hand.vertices) == 1 else at.blended(hand.vertices)
        if not at.there.all():
            missing = int((~at.there).sum())
            raise PoseError(
                f"hand {name} is missing in {missing} of {len(base)} poses: a hand mesh must be there always"
            )
        if motion is not base:
            place = compose(invert(base.pose), at.poses(motion.pose[:, None])[:, 0])[:, None]
            own = place[..., :3] + rotate(place[..., 3:], own.astype(np.float64))
        vertices.append(np.broadcast_to(own, (len(base), *own.shape[1:])).astype(np.float32))
        faces.append(hand.faces + count)
        glabrous.append(hand.glabrous)
        count += own.shape[1]
    steps = [hand.step for hand, _ in hands if hand.step is not None]
    return MeshHand(
        np.concatenate(vertices, axis=1),
        np.concatenate(faces),
        glabrous=np.concatenate(glabrous),
        step=min(steps) if steps else None,
        name=" and ".join(names),
    )


def require_fitting(hand: Hand, motion: HandMotion, base: HandMotion, name: str) -> None:
    """Raise PoseError unless a hand's rows are its motion's, and its motion has times as the first hand's has."""
    if hand.pose_count not in (None, len(motion)):
        raise PoseError(f"hand {name} is articulated for {hand.pose_count} poses, but its motion has {len(motion)}")
    if (motion.time is None) != (base.time is None) or (motion.time is None and len(motion) != len(base)):
        raise PoseError(
            f"hand {name}: its motion has {_description(motion)}, the first hand's {_description(base)}; "
            "give all of them times, or none and as many poses"
        )


def _description(motion: HandMotion) -> str:
    return f"{len(motion)} poses {'without' if motion.time is None else 'over'} time"


def _span(motion: HandMotion) -> str:
    time = np.zeros(1) if motion.time is None else motion.time
    return f"{motion.offset + time[0]:.2f}..{motion.offset + time[-1]:.2f} s"


@dataclass(frozen=True)
class Times:
    """Where among the rows of one motion the times of another lie."""

    before: np.ndarray
    """Row before each time, shape [time]."""
    after: np.ndarray
    """Row after it, or the same."""
    share: np.ndarray
    """How far on the way from the one to the other, 0..1."""
    there: np.ndarray
    """Whether there is anything: the time lies within the motion, and in no gap; bool."""

    @classmethod
    def of(cls, motion: HandMotion, base: HandMotion, *, same_clock: bool, gap: float) -> "Times":
        """Times of `base` among those of `motion`, see `together`; row by row without time."""
        if motion.time is None or base.time is None or motion is base:
            row = np.arange(len(base))
            return cls(row, row, np.zeros(len(base)), np.ones(len(base), bool))
        time, at = motion.time, base.time + (base.offset - motion.offset if same_clock else 0.0)
        there = (at >= time[0] - TIME_ROUNDING) & (at <= time[-1] + TIME_ROUNDING)
        if not there.any():
            raise PoseError(
                f"a hand has poses at {_span(motion)}, the first one at {_span(base)}: they never meet; "
                "same_clock=False lets them begin together"
            )
        at = np.clip(at, time[0], time[-1])
        before = np.clip(np.searchsorted(time, at, side="right") - 1, 0, max(len(time) - 2, 0))
        after = np.minimum(before + 1, len(time) - 1)
        span = time[after] - time[before]
        share = np.where(span > 0.0, (at - time[before]) / np.where(span > 0.0, span, 1.0), 0.0)
        longest = max(gap, 2.0 * float(np.median(np.diff(time)))) if len(time) > 1 else gap
        return cls(before, after, share, there & ~((span > longest) & (share % 1.0 > 0.0)))

    def blended(self, rows: np.ndarray) -> np.ndarray:
        """Numbers [row, ...] at these times, linear in between; a row that is met is taken as it is."""
        share = self.share.reshape(-1, *[1] * (rows.ndim - 1))
        one, two = rows[self.before].astype(np.float64), rows[self.after].astype(np.float64)
        return np.where(share == 0.0, one, np.where(share == 1.0, two, one + share * (two - one)))

    def poses(self, rows: np.ndarray) -> np.ndarray:
        """Poses [row, patch, 7] at these times, turned along the shortest way; NaN where there is none."""
        from scipy.spatial.transform import Rotation  # a tenth of a second that single hands do without

        out = self.blended(rows)
        out[~self.there] = np.nan
        between = self.there & (self.share % 1.0 > 0.0)
        for k in range(rows.shape[1]):
            row = np.flatnonzero(between & ~np.isnan(out[:, k]).any(axis=1))
            if len(row):
                one, two = (Rotation.from_quat(rows[end[row], k, 3:]) for end in (self.before, self.after))
                turn = (one.inv() * two).as_rotvec() * self.share[row, None]
                out[row, k, 3:] = (one * Rotation.from_rotvec(turn)).as_quat()
        return out
