"""The benchmarks of noise run, small, and say what they should."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import noise
import noise_study

pytestmark = pytest.mark.exhaustive


def test_times_are_of_each_kind_and_fewer_sources_are_louder():
    frames = noise.circle(0.25)
    assert (frames.duration, frames.delay.shape) == (0.25, (10_000, 256))
    figures = noise.measure("transducers", frames, "cpu", 1)
    assert figures["resident_seconds"] > 0
    assert 0 < figures["seconds"] < 20
    few, many = noise.convergence(frames, (10, 1000), "cpu")
    assert few["level"] > many["level"] + 10
    assert few["spread"] > 0


def test_the_study_compares_models_and_remedies(tmp_path, monkeypatch):
    monkeypatch.setattr(noise_study, "MODELS", {name: noise_study.MODELS[name] for name in ("beam", "transducers")})
    kept = (
        "plain",
        "restart at every pose",
        "amplitude dips for 2 ms at jumps",
        "slew 4/256",
        "poses interpolated to 1 mm",
    )
    monkeypatch.setattr(noise_study, "REMEDIES", {name: noise_study.REMEDIES[name] for name in kept})
    noise_study.render_files(tmp_path, 2, 5.0)
    assert len(list(tmp_path.glob("*.h5"))) == 8
    models, remedies = noise_study.study(tmp_path, 2, "cpu")
    assert set(models["models"]) == {"beam", "transducers", "beam, time derivative 1", "beam, time derivative 2"}
    assert models["models"]["beam"]["db_300_10k"]["mean"] > 0
    assert np.isfinite(models["models"]["beam"]["shape"])
    assert remedies["remedies"]["plain"]["cc"]["dba"] == 0
    assert remedies["remedies"]["restart at every pose"]["cc"]["dba"] > 0
    assert remedies["remedies"]["slew 4/256"]["oc"]["dba"] < remedies["remedies"]["plain"]["oc"]["dba"]
