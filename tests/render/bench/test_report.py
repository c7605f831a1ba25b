"""`palpate bench`: its objects, its clocks, its curves, and what the command says."""

import json
import os

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from palpate.render.bench import clocks as bench_measure
from palpate.render.bench import curves as bench_curve
from palpate.render.bench.cases import bench_object, blob, random_poses
from palpate.render.bench.clocks import (
    OwnTurn,
    Yield,
    interleaved,
)
from palpate.render.bench.curves import pose_curve, triangle_curve
from palpate.render.bench.peers import one_core
from palpate.render.bench.turns import BenchOptions
from palpate.render.cli.app import app
from palpate.render.contour_batch import ContourBatch
from palpate.render.errors import StrategyError
from palpate.render.hands.hand import Palm
from palpate.render.strategies.intersection_strategy import closed_contour


@pytest.fixture(autouse=True)
def _small_copies(monkeypatch):
    monkeypatch.setattr(bench_measure, "COPY_BYTES", {True: 2**20, False: 2**20})


# Objects and poses


@pytest.mark.parametrize("frequency", [1, 3, 8])
def test_blob_is_one_closed_body_within_the_cube(frequency):
    vertices, faces = blob(frequency)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert len(faces) == 20 * frequency**2
    assert len(vertices) == 10 * frequency**2 + 2
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert mesh.volume > 0
    assert np.abs(vertices - [0, 0, 0.2]).max() <= 0.065


@pytest.mark.parametrize("name", ["blob", "blob-3", "blob-99m", "sphere-1k", "bunny.stl"])
def test_unknown_objects_are_refused(name):
    with pytest.raises(StrategyError, match="unknown benchmark object"):
        bench_object(name)


# Clocks and counts


@pytest.mark.exhaustive
def test_calls_take_turns_and_none_is_always_first():
    seen = []
    clocks = interleaved([lambda name=name: seen.append(name) for name in "abc"], 3)
    assert seen == list("abcbcacab")
    assert [clock.repeats for clock in clocks] == [3, 3, 3]


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
    assert (found.poses, found.hit, found.vertices, found.segments, found.polylines) == (3, 1, 5, 4, 2)
    assert found.floor(1e3) == pytest.approx((28 * 3 + 12 * 5 + 8 * 2) / 1e3)
    assert found.bytes == sum(array.nbytes for array in batch.arrays().values())


def test_chunks_change_nothing(device, monkeypatch):
    thing, pose = bench_object("tube"), random_poses(100)
    whole = Yield.of(OwnTurn(thing, Palm(), pose, closed_contour(), device)())
    monkeypatch.setattr(bench_measure, "CHUNK_POSES", {True: 7, False: 7})
    parts = OwnTurn(thing, Palm(), pose, closed_contour(), device)()
    assert len(parts) == 15
    assert Yield.of(parts).points == whole.points


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system cannot keep a process to one core")
def test_one_core_is_put_back_whatever_happens():
    allowed, threads = os.sched_getaffinity(0), os.environ.get("OMP_NUM_THREADS")
    seen = []

    def fail():
        with one_core(True) as core:
            seen.extend([core, *os.sched_getaffinity(0), os.environ["OMP_NUM_THREADS"]])
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert seen == [seen[0], seen[0], "1"]
    assert os.sched_getaffinity(0) == allowed
    assert os.environ.get("OMP_NUM_THREADS") == threads
    with one_core(False) as core:
        assert core is None


# Curves, first use, the command


@pytest.mark.exhaustive
def test_curves_have_a_point_a_size(monkeypatch):
    options = BenchOptions(poses=20, repeats=1)
    curve = triangle_curve(options, frequencies=(2, 4, 8))
    assert [point.triangles for point in curve.points] == [80, 320, 1280]
    first, last = curve.points[0], curve.points[-1]
    assert curve.slope_theory == pytest.approx(np.log(last.theory / first.theory) / np.log(16), abs=0.3)
    poses = pose_curve(options, counts=(10, 40))
    assert [point.poses for point in poses.points] == [10, 40]
    assert poses.slope_theory == pytest.approx(1.0)
    monkeypatch.setattr(bench_curve, "SECONDS_MOST", 0.0)
    assert pose_curve(options, counts=(10,)).left_out == ("256 triangles, 10 poses",)


def _run(*arguments):
    return CliRunner().invoke(app, ["bench", *arguments], catch_exceptions=False)


@pytest.mark.exhaustive
def test_command_reports_every_figure_as_json():
    result = _run("--objects=cube,blob-80", "--strategies=cc", "--poses=50", "--repeats=1", "--peers=none", "--json")
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert [row["object"] for row in told["rows"]] == ["cube", "blob-80"]
    row = told["rows"][0]
    assert (row["triangles"], row["poses"], row["hit"], row["peers"]) == (12, 50, 1.0, [])
    assert row["floor_ratio"] == pytest.approx(row["us_wall"] / row["floor_us"])
    assert sum(row["stages"].values()) == pytest.approx(1.0)
    assert {"date", "machine", "versions", "options", "core"} <= set(told)


def test_command_refuses_misuse():
    misuses = {"--objects": "banana", "--strategies": "xy", "--device": "cuda:9", "--poses": "0", "--peers": "nobody"}
    for option, value in misuses.items():
        options = {"--objects": "cube", "--strategies": "oc", "--peers": "none", option: value}
        result = _run(*(word for pair in options.items() for word in pair))
        assert result.exit_code == 2, option
        assert "Traceback" not in result.output
        assert value in result.stderr or "greater than or equal" in result.stderr
