"""Scans in float32 against heights in float64, and walks of queries whose crossings share bits."""

import numpy as np
import pytest
import warp as wp
from degenerate_cases import HALF
from drawing import STRATEGIES, assert_same_bits, draw, exact_poses, patch_array, pose_array, surface_on
from mesh_cases import CLOSED, MESHES
from scipy.spatial.transform import Rotation

from palpate.kernels.section import half_edges
from palpate.kernels.section.float32_walk import room_for_scans
from palpate.kernels.section.half_edges import OPEN
from palpate.kernels.section.scan import _scan_sections


def scan(surface, poses, device):
    """Words, listed queries with their numbers of crossings, and doubtful queries, of palms."""
    queries, counters = len(poses), wp.zeros(3, dtype=wp.int32, device=device)
    scans = room_for_scans(surface, queries, counters, wp.get_device(device))
    events, doubtful = (wp.full(queries, -1, dtype=wp.int32, device=device) for _ in range(2))
    inputs = [
        surface,
        pose_array(poses, device),
        patch_array(HALF, device),
        1,
        wp.empty(0, dtype=wp.int32, device=device),
    ]
    wp.launch(_scan_sections, queries, inputs=inputs, outputs=[scans, events, doubtful, counters[2:]], device=device)
    words = scans.word.numpy()[np.arange(queries)[:, None] * scans.stride + np.arange(surface.scan_words) * scans.step]
    listed, count = scans.listed.numpy(), counters.numpy()
    return words, dict(listed[: count[0]].tolist()), set(doubtful.numpy()[: count[2]].tolist()), events.numpy()


def crossed_bits(edges, group, pose):
    """Bits of the steps of the scan path that cross a palm's plane, and how many such steps there are."""
    vertices, halves = edges.scan_path
    normal = Rotation.from_quat(pose[3:].astype(float)).apply([0.0, 1.0, 0.0])
    above = (edges.vertices[vertices].astype(float) - pose[:3]) @ normal > 0
    step = np.flatnonzero((above[1:] != above[:-1]) & (halves != OPEN))
    return set((step // group).tolist()), len(step)


@pytest.mark.parametrize("words", [1, half_edges.SCAN_WORDS])
@pytest.mark.parametrize("name", CLOSED)
def test_a_scan_notes_the_steps_that_cross_the_plane(name, words, device, monkeypatch):
    monkeypatch.setattr(half_edges, "SCAN_WORDS", words)
    edges, poses = half_edges.HalfEdges(*MESHES[name]()), exact_poses(70, 3)
    surface = half_edges.upload_surface(edges, device)
    assert surface.scan_words <= words
    noted, listed, doubtful, events = scan(surface, poses, device)
    for query in set(range(len(poses))) - doubtful:
        bits, count = crossed_bits(edges, surface.scan_group, poses[query])
        assert {k for k in range(32 * surface.scan_words) if noted[query, k // 32] >> (k % 32) & 1} == bits
        assert listed.get(query, 0) == count
        assert count > 0 or events[query] == 0
    assert len(doubtful) < len(poses) // 4


@pytest.mark.parametrize("name", CLOSED)
def test_queries_whose_crossings_share_bits_keep_their_contours(name, device, monkeypatch):
    monkeypatch.setattr(half_edges, "SCAN_WORDS", 1)
    surface, poses, patch = surface_on(MESHES[name](), device), exact_poses(200, 4), patch_array(HALF, device)
    for strategy in STRATEGIES:
        traced, sought = (draw(surface, poses, patch, strategy, method) for method in ("scan", "tree"))
        assert_same_bits(traced, sought)
