"""Peers of benchmarks/bench.py: their completion, their agreement, and that a wrong one is told from a right one."""

import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import bench
from bench import OBJECTS, Trial, Yield, compare, lengths_of, measure_trial
from libraries import PEERS, find_peers
from peers import Declined, Peer, check_peer
from section_completion import PalmFrames, Polylines, clipped, rings_of

from palpate.render.bench.cases import bench_object, random_poses
from palpate.render.contour_batch import ContourBatch
from palpate.render.hands.hand import Palm
from palpate.render.intersection.mesh_section import intersect
from palpate.render.strategies.intersection_strategy import load_strategy


@pytest.fixture(autouse=True)
def _small_copies(monkeypatch):
    monkeypatch.setattr(bench, "COPY_BYTES", {True: 2**20, False: 2**20})
    monkeypatch.setattr(bench, "COPIES", 1)


# Completion: the palm is 85 mm square, half 42.5


def _ring(*boxes, turn=1):
    """Rings around boxes (low u, low v, high u, high v) [mm] of pose 0; a hole has its corners the other way round."""
    rings = []
    for box in boxes:
        a, b, c, d = (1e-3 * x for x in box)
        ring = np.array([[a, b], [c, b], [c, d], [a, d]])
        rings.append(ring[::turn])
    return rings_of(rings, [0] * len(rings), repeats=False)


BOXES = {
    # name: boxes, OC length [mm] and lines, CC length and lines
    "inside": ([(-10, -10, 10, 10)], (80, 1), (80, 1)),
    "apart": ([(50, 50, 60, 60)], (0, 0), (0, 0)),
    "around": ([(-90, -90, 90, 90)], (0, 0), (340, 1)),
    "starts inside": ([(0, -10, 90, 10)], (105, 1), (125, 1)),
    "across": ([(-90, -10, 90, 10)], (170, 2), (210, 1)),
    "two shells": ([(-90, -10, -30, 10), (30, -10, 90, 10)], (90, 2), (130, 2)),
    "hole": ([(-90, -90, 90, 90), (-10, 10, 10, -10)], (80, 1), (420, 2)),
    "shell in a hole": ([(-90, -90, 90, 90), (-20, 20, 20, -20), (-5, -5, 5, 5)], (200, 2), (540, 3)),
}


@pytest.mark.parametrize("turn", [1, -1, 0])
def test_rings_are_clipped_and_closed(turn):
    for name, (boxes, *expected) in BOXES.items():
        rings = _ring(*boxes, turn=-1 if turn == -1 else 1)
        for closed, (length, lines) in zip((False, True), expected, strict=True):
            found = clipped(rings, Palm(), closed=closed, turn=turn)
            assert found.lengths(1)[0] == pytest.approx(1e-3 * length), (name, closed)
            assert found.counts(1, longer_than=1e-9)[0] == lines, (name, closed)


# Peers


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("strategy", ["oc", "cc"])
@pytest.mark.parametrize("name", list(PEERS))
def test_peer_gives_the_same_contours_on_every_object(name, strategy):
    found, absent = find_peers([name])
    if absent:
        pytest.skip(f"{name}: {absent[0].reason}")
    for thing in OBJECTS:
        found[0].setup(bench_object(thing), Palm())
        agreement = check_peer(found[0], bench_object(thing), Palm(), random_poses(50), load_strategy(strategy))
        assert (agreement.apart, agreement.lines_apart) == (0, 0), f"{thing}: {agreement.text()}"


class Mirror(Peer):
    """A peer that gives our own contours, or a fault of them."""

    name, packages, licence = "mirror", ("numpy",), "none"
    scale = 1.0
    lost = 0
    fault: Exception | None = None

    def setup(self, thing, hand):
        if self.fault:
            raise self.fault
        self.thing, self.hand = thing, hand

    def contours(self, pose, strategy):
        batch = intersect(self.thing, self.hand, wp.array(pose, dtype=wp.transform, device="cpu"), strategy)[0].numpy()
        owner = np.repeat(np.arange(len(pose)), np.diff(batch.pose_start))
        size = np.diff(batch.polyline_start)
        flat = PalmFrames.of(pose).flat(self.scale * batch.points.astype(np.float64), np.repeat(owner, size))
        found = Polylines(flat, batch.polyline_start, owner)
        return found.select(np.arange(len(owner)) % 10 != 0) if self.lost else found


def _mirror(**faults):
    peer = Mirror()
    for name, value in faults.items():
        setattr(peer, name, value)
    return peer


def _trial(strategy="cc", poses=100, **options):
    return Trial("tube", strategy, random_poses(poses), repeats=1, **options)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("faults", "state"),
    [
        ({}, "timed"),
        ({"scale": 1.0005}, "disagrees"),
        ({"lost": 1}, "disagrees"),
        ({"fault": OSError("gone")}, "failed"),
        ({"fault": Declined("large")}, "declined"),
    ],
    ids=lambda value: str(value),
)
def test_a_wrong_peer_is_reported_and_not_timed(faults, state):
    row = measure_trial(_trial(seconds=0.001), [_mirror(**faults)])
    (peer,) = row["peers"]
    assert peer["state"] == state
    if state == "timed":
        assert (row["peer"], row["peer_ratio"]) == ("mirror", peer["ratio"])
        assert peer["us"] > 0
    else:
        assert (row["peer"], peer["us"]) == (None, None)
        assert peer["note"]


def test_a_peer_that_is_not_installed_is_no_error(monkeypatch):
    monkeypatch.setitem(sys.modules, "vtkmodules.vtkFiltersCore", None)
    found, absent = find_peers(["vtk"])
    assert found == []
    assert absent[0].name == "vtk"
    assert "cannot be imported" in absent[0].reason


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", OBJECTS)
def test_a_case_measures_what_it_renders(name, device):
    trial = Trial(name, "cc", random_poses(50), device, repeats=1)
    figures, lengths = measure_trial(trial), lengths_of(trial)
    assert lengths.shape == (50, 3)
    assert figures["hit"] == np.mean(lengths.sum(axis=1) > 0)
    assert figures["floor_ratio"] == pytest.approx(figures["us_wall"] / figures["floor_us"])
    assert sum(figures["stages"].values()) == pytest.approx(1.0)
    assert compare(lengths, lengths)["equal_bits"] == 50
    assert compare(lengths, lengths + np.float32(0.1))["apart_over_1e-5"] == 50


def test_distinct_vertices_leave_out_repeated_ones_and_the_floor_counts_each_byte_once():
    batch = ContourBatch(
        points=np.zeros((6, 3), np.float32),
        kind=np.zeros(6, np.uint8),
        polyline_start=np.array([0, 4, 6]),
        polyline_patch=np.zeros(2, np.int32),
        polyline_closed=np.array([1, 0], np.uint8),
        pose_start=np.array([0, 2, 2, 2]),
    )
    found = Yield.of([batch])
    assert (found.poses, found.hit, found.vertices, found.polylines) == (3, 1, 5, 2)
    assert found.floor(1e3) == pytest.approx((28 * 3 + 12 * 5 + 8 * 2) / 1e3)
