"""Focal points from a contour file to `palpate-ultraleap`: what the fake array behind the library's stub was handed.

The bridge is compiled against a stub of the vendor's library, whose fake array records each device sample, 40,000 a
second for one focal point. Nothing here is hardware.
"""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from devices.ultraleap_bridge import RATE, Bridge, shared_program

from palpate.device import DeviceBusyError, DeviceLostError, LinkError, array_model, open_link
from palpate.render import SamplingStrategy, Session, Stimulus, play_file, prepare_frames, render, static_pose

pytestmark = pytest.mark.exhaustive


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    return shared_program(tmp_path_factory)


@pytest.fixture(scope="session")
def contours(tmp_path_factory):
    batch = render("cube", "palm", static_pose([0.01, 0.02, 0.2]), "cc")
    return batch.save(tmp_path_factory.mktemp("contours") / "cube.h5")


def recorded(path, points=1, start=1):
    """x, y, z, intensity of each point of each device sample, shape [device sample, point, 4]."""
    rows = np.fromfile(f"{path}.{start}", np.dtype([("time", "<f8"), ("points", "<f4", (points, 4))]))
    return rows["points"]


def sounding(rows):
    """The part from the first sample that sounds to the last one; all before and after is silent."""
    on = np.flatnonzero(rows[:, :, 3].any(axis=1))
    return rows[on[0] : on[-1] + 1]


def sent_by(path, sampling, duration, points=1):
    """What palpate's own sampling gives, without its drive, player and link."""
    from palpate.render.playback.focal_points import open_focal_points
    from palpate.render.playback.placed_arrays import PlacedArray

    arrays = (PlacedArray(array_model("stratos")),)
    with open_focal_points(path, sampling, duration, arrays, has_points=False) as (source, _):
        blocks = [np.concatenate([f.position.reshape(-1, points, 3), f.intensity.reshape(-1, points, 1)], axis=2) for f in source]
    return np.concatenate(blocks).astype(np.float32)


@pytest.mark.parametrize(("rate", "points"), [(40e3, 1), (10e3, 1), (40e3 / 3, 1), (10e3, 4)])
def test_the_library_is_handed_each_focal_point_in_order_none_twice_none_lost(program, contours, tmp_path, rate, points):
    sampling = SamplingStrategy(update_rate=rate, foci=points)
    with Bridge(program, record=tmp_path / "seen", rates=",".join([str(RATE)] * points)) as bridge:
        playback = play_file(
            contours, array="stratos", sampling=sampling, duration=0.5, array_serial=None
        ) if False else play_bridge(contours, bridge, sampling=sampling, duration=0.5)
    sent = sent_by(contours, sampling, 0.5, points)
    seen = sounding(recorded(tmp_path / "seen", points))
    assert len(sent) == playback.frames == round(0.5 * rate)
    # each sample is held for RATE / rate device samples: those due before the next one
    held = np.repeat(np.arange(len(sent)), np.diff(np.ceil(np.arange(len(sent) + 1) * RATE / rate - 0.5)).astype(int))
    positions, levels = sent[held][:, :, :3], sent[held][:, :, 3]
    np.testing.assert_array_equal(seen[:, :, :3], positions[: len(seen)])
    np.testing.assert_allclose(seen[:, :, 3], levels[: len(seen)], rtol=0, atol=0 if points == 1 else 2**-16)
    assert len(seen) == len(held)
    assert playback.played.off_confirmed is None
    assert playback.played.board_underruns == 0


def play_bridge(path, bridge, **options):
    from palpate.render.playback.placed_arrays import load_rig

    return play_file(path, array=load_rig("stratos", serial=f"127.0.0.1:{bridge.port}"), **options)
