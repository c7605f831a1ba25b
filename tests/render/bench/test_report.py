"""`palpate bench`: its objects, its clocks, its curves, and what the command says."""

import json

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from palpate.render.bench import clocks as bench_measure
from palpate.render.bench.cases import bench_object, blob
from palpate.render.bench.clocks import (
    Yield,
)
from palpate.render.cli.app import app
from palpate.render.contour_batch import ContourBatch
from palpate.render.errors import StrategyError


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


# Curves, first use, the command


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
