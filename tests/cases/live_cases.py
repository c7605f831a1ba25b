"""Live runs for the tests of their files: poses that take effect at given samples, and what `Instant` drew of them."""

import numpy as np

from palpate.render import Palm, closed_contour, exploration
from palpate.render.intersection.named_inputs import solid_of
from palpate.render.live.instant import Instant
from palpate.render.live.recording import LiveSegment
from palpate.render.sampling.strategy import SamplingStrategy

RATE = 10_000.0
MOTION = exploration("tube", duration=1.2, rate=150.0, seed=1)


def run_live(first, *, sampling=None, hand=None, patch_pose=None, last=300, interval=1 / 90, pose=None):
    """A live run of poses that take effect at samples `first`; the last pose lasts `last` samples."""
    sampling, hand = sampling or SamplingStrategy(), hand or Palm()
    first = np.asarray(first)
    time, pose = first / sampling.update_rate, MOTION.pose[50 : 50 + len(first)] if pose is None else pose
    instant = Instant(solid_of("tube"), hand, closed_contour(), sampling, interval=interval)
    until = np.append(time[1:], (first[-1] + last) / sampling.update_rate)
    own = [None] * len(first) if patch_pose is None else patch_pose
    blocks = [instant.draw(pose[i], time[i], until=until[i], patch_pose=own[i]) for i in range(len(first))]
    position, intensity = (np.concatenate(part) for part in zip(*blocks, strict=True))
    assert intensity.any()
    return LiveSegment(
        solid=solid_of("tube"), hand=hand, strategy=closed_contour(), sampling=sampling,
        hold=max(sampling.hold, 2 * interval), time=time, pose=pose, patch_pose=patch_pose,
        stamp=time - 0.006, emitted=time + 0.001, position=position, intensity=intensity, gain=None,
        mark=np.zeros(len(intensity), np.uint8), events=[(-0.25, "lost", "no hand, \N{GREEK SMALL LETTER MU}")],
        source="udp", array="emulator", lead=0.008, realtime=True, emission="estimate",
    )  # fmt: skip


def regular(rate, count, jitter=0.0):
    """First samples of poses that come at a rate [Hz], each late by up to `jitter` [s]."""
    late = np.random.default_rng(3).uniform(0, jitter, count)
    first = np.ceil((np.arange(count) / rate + late) * RATE).astype(int)
    return first - first[0]
