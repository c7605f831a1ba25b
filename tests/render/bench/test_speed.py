"""`palpate bench`: its objects, its figures, and its misuses."""

import json

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from palpate.render.bench.cases import bench_object, blob
from palpate.render.cli.app import app
from palpate.render.errors import StrategyError


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


def run(*arguments):
    return CliRunner().invoke(app, ["bench", *arguments], catch_exceptions=False)


@pytest.mark.exhaustive
def test_each_object_and_strategy_has_its_figures():
    result = run("--objects=cube,blob-80", "--strategy=cc", "--poses=50", "--json")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert {"palpate", "warp", "machine"} <= set(report)
    cube, other = report["rows"]
    assert (cube["object"], cube["triangles"], cube["poses"], cube["hit"]) == ("cube", 12, 50, 1.0)
    assert (other["object"], other["triangles"]) == ("blob-80", 80)
    assert cube["points_per_pose"] >= 4  # a closed section has three corners at least, and repeats the first
    assert cube["poses_per_second"] == pytest.approx(1 / cube["seconds_per_pose"])


def test_misuse_is_refused():
    values = {"--objects": "banana", "--strategy": "hatch", "--device": "cuda:9", "--poses": "0"}  # hatch has a stage
    for option, value in values.items():
        result = run(*(word for pair in ({"--objects": "cube"} | {option: value}).items() for word in pair))
        assert result.exit_code == 2, option
        assert value in result.stderr or "x>=1" in result.stderr
