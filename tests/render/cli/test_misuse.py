"""Options that mean nothing are misuse, whatever the object: one sentence, exit code 2, nothing written."""

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.render.cli.app import app

VOXELISE = ["voxelise", "tube", "-o"]


@pytest.fixture
def volume(tmp_path):
    path = tmp_path / "block.npz"
    inside = np.zeros((12, 12, 12), bool)
    inside[3:-3, 3:-3, 3:-3] = True
    np.savez(path, values=inside, affine=np.diag([0.005, 0.005, 0.005, 1.0]))
    return path


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["out.npz", "--spacing", "0"], "--spacing must be a positive length in metres, not 0"),
        (["out.npz", "--spacing", "nan"], "--spacing must be a positive length in metres, not nan"),
        (["out.npz", "--spacing", "0.01", "--kind", "x"], "--kind must be one of distance, occupancy, not 'x'"),
        (["out.npz", "--spacing", "0.01", "--sign", "x"], "--sign must be one of auto, crossings, parity, winding"),
        (["out.tif", "--spacing", "0.01"], "out.tif: voxels are written to .npz, "),
    ],
)
def test_voxelising_with_options_that_mean_nothing(arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, [*VOXELISE, *arguments])
    assert (done.exit_code, list(tmp_path.iterdir())) == (2, [])
    assert said in done.stderr


@pytest.mark.parametrize(
    ("thing", "arguments", "said"),
    [
        ("tube", ["--simplify", "-1"], "--simplify must be a length in metres of 0 or more, not -1"),
        ("tube", ["--simplify", "nan"], "--simplify must be a length in metres of 0 or more, not nan"),
        ("volume", ["--kind", "x"], "--kind must be one of occupancy, distance, intensity, label, not 'x'"),
        ("volume", ["--unit", "inch"], "--unit must be one of m, cm, mm, um, not 'inch'"),
        ("volume", ["--inside", "x"], "--inside must be one of below, above, not 'x'"),
        ("volume", ["--spacing", "0.01", "0", "0.01"], "--spacing must be positive lengths in metres"),
        ("volume", ["--level", "nan"], "--level must be finite, not nan"),
    ],
)
def test_rendering_with_options_that_mean_nothing(thing, arguments, said, volume, tmp_path):
    source = str(volume) if thing == "volume" else thing
    done = CliRunner().invoke(app, ["render", source, "exploration", "-o", str(tmp_path / "out.h5"), *arguments])
    assert done.exit_code == 2
    assert said in done.stderr
    assert not list(tmp_path.glob("out*"))
