"""`palpate bench`: its objects, its clocks, its curves, and what the command says."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
import warp as wp
from typer.testing import CliRunner

from palpate.render.bench import clocks as bench_measure
from palpate.render.bench import curves as bench_curve
from palpate.render.bench import first_use as bench_first_use
from palpate.render.bench.cases import bench_object, bench_poses, blob, random_poses
from palpate.render.bench.clocks import (
    COPY_COUNT,
    Clocks,
    CopyTurn,
    CountingAllocator,
    OwnTurn,
    Yield,
    fitting_count,
    interleaved,
    memory_peak,
)
from palpate.render.bench.curves import pose_curve, power, triangle_curve
from palpate.render.bench.first_use import measure_first_use
from palpate.render.bench.peers import one_core
from palpate.render.bench.turns import BenchOptions
from palpate.render.cli.app import app
from palpate.render.contour_batch import ContourBatch
from palpate.render.errors import RenderError, StrategyError
from palpate.render.hands.hand import Palm
from palpate.render.intersection.mesh_section import intersect
from palpate.render.strategies.intersection_strategy import closed_contour


@pytest.fixture(autouse=True)
def _small_copies(monkeypatch):
    monkeypatch.setattr(bench_measure, "COPY_BYTES", {True: 2**20, False: 2**20})


# Objects and poses


@pytest.mark.parametrize("frequency", [1, 2, 3, 8, 21])
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


def test_blob_is_the_same_surface_at_every_number_of_triangles():
    coarse, _ = blob(4)
    fine, _ = blob(8)
    apart = np.linalg.norm(coarse[:, None] - fine[None], axis=2).min(axis=1)
    assert apart.max() < 1e-7


@pytest.mark.exhaustive
def test_blob_is_star_shaped_and_has_sections_of_several_loops():
    thing = bench_object("blob-5000")
    poses = random_poses(200)
    batch = intersect(thing, Palm(0.5, 0.5), wp.array(poses, dtype=wp.transform, device="cpu"), closed_contour())[0]
    loops = np.diff(batch.numpy().pose_start)
    assert loops.max() >= 2
    radius = np.linalg.norm(thing.vertices - thing.bounds.mean(axis=0), axis=1)
    assert radius.min() < 0.5 * radius.max()  # deep concavities


@pytest.mark.parametrize("name", ["blob", "blob-3", "blob-99m", "sphere-1k", "bunny.stl"])
def test_unknown_objects_are_refused(name):
    with pytest.raises(StrategyError, match="unknown benchmark object"):
        bench_object(name)


def test_blobs_are_named_by_their_triangles():
    assert len(bench_object("blob-5k").faces) == pytest.approx(5000, rel=0.1)
    assert bench_object("blob-80").faces.shape == (80, 3)


def test_poses_are_random_or_explore():
    thing = bench_object("cube")
    np.testing.assert_array_equal(bench_poses("random", thing, 30), random_poses(30))
    assert bench_poses("exploration", thing, 31).shape == (31, 7)
    with pytest.raises(StrategyError, match="at least 1"):
        bench_poses("random", thing, 0)
    with pytest.raises(StrategyError, match="unknown motion"):
        bench_poses("still", thing, 1)


# Clocks and counts


@pytest.mark.exhaustive
def test_calls_take_turns_and_none_is_always_first():
    seen = []
    clocks = interleaved([lambda name=name: seen.append(name) for name in "abc"], 3)
    assert seen == list("abcbcacab")
    assert [clock.repeats for clock in clocks] == [3, 3, 3]


@pytest.mark.parametrize(("cost", "count"), [(1e-3, 500), (0.9e-3, 500), (4e-3, 100), (1.0, 10), (1e-9, 9000)])
def test_counts_fit_the_time(cost, count):
    assert fitting_count(cost, 0.5, 10, 9000) == count


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


def test_a_copy_counts_what_it_reads_and_what_it_writes(device):
    assert CopyTurn(device).rate(Clocks(cpu=9.0, wall=0.5, repeats=1)) == 2 * 2**20 * COPY_COUNT[device != "cpu"] / 0.5


def test_chunks_change_nothing(device, monkeypatch):
    thing, pose = bench_object("tube"), random_poses(100)
    whole = Yield.of(OwnTurn(thing, Palm(), pose, closed_contour(), device)())
    monkeypatch.setattr(bench_measure, "CHUNK_POSES", {True: 7, False: 7})
    parts = OwnTurn(thing, Palm(), pose, closed_contour(), device)()
    assert len(parts) == 15
    assert Yield.of(parts).points == whole.points


class _Heap:
    """An allocator that only numbers what it gives."""

    deallocate_requires_context_guard = False
    memory_kind = None

    def __init__(self):
        self.freed = []

    def allocate(self, size_in_bytes):
        return size_in_bytes

    def deallocate(self, ptr, size_in_bytes):
        self.freed.append(ptr)


def test_memory_is_counted_at_its_peak():
    heap = _Heap()
    counting = CountingAllocator(heap)
    first = counting.allocate(10)
    counting.allocate(20)
    counting.deallocate(first, 10)
    counting.allocate(5)
    assert (counting.live, counting.most, heap.freed) == (25, 30, [first])


def test_peak_memory_holds_the_results_at_least(device):
    own = OwnTurn(bench_object("tube"), Palm(), random_poses(1000), closed_contour(), device)
    batches, peak = memory_peak(own, device)
    result = Yield.of(batches).bytes
    if device == "cpu":
        assert peak is None
    else:
        assert peak.arrays >= result
        assert peak.pool is None or peak.pool >= result


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


def test_power_law_is_found():
    assert power([10, 100, 1000], [2, 20, 200]) == pytest.approx(1.0)
    assert power([10], [2]) is None


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


@pytest.mark.exhaustive
def test_first_use_starts_with_an_empty_cache(monkeypatch, tmp_path):
    script = tmp_path / "stands_in.py"
    script.write_text(
        "import os, pathlib, sys, time\n"
        "cache = pathlib.Path(os.environ['WARP_CACHE_PATH'])\n"
        "if sys.argv[1] == 'render':\n"
        "    with open(sys.argv[0] + '.log', 'a') as log: log.write(f'{cache.exists()} ')\n"
        "    cache.mkdir(exist_ok=True)\n"
    )
    monkeypatch.setattr(bench_first_use, "PALPATE", (sys.executable, str(script)))
    first = measure_first_use("cpu")
    assert Path(f"{script}.log").read_text().split() == ["False", "True", "True", "True"]
    assert first.cold > 0
    script.write_text("import sys; sys.exit('no room')")
    with pytest.raises(RenderError, match="no room"):
        measure_first_use("cpu")


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


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--objects", "banana"),
        ("--strategies", "xy"),
        ("--device", "cuda:9"),
        ("--poses", "0"),
        ("--repeats", "0"),
        ("--peers", "nobody"),
        ("--motion", "still"),
    ],
)
def test_command_refuses_misuse(option, value):
    options = {"--objects": "cube", "--strategies": "oc", "--peers": "none", option: value}
    result = _run(*(word for pair in options.items() for word in pair))
    assert result.exit_code == 2
    assert "Traceback" not in result.output
    assert value in result.stderr or "greater than or equal" in result.stderr
