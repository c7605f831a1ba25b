"""Strategies that change between sweeps: what CI is told; and what a store has lost of its tables is written again."""

import json
import subprocess
from pathlib import Path

import pytest
from command_line import PALPATE, answer, run

from palpate.datasets.sweeps.table import load_table

PLAN = """
metrics = ["contours", "frequency"]
per_pose = true
[object]
source = "tube"
[motion]
source = "random"
count = 300
[strategy]
source = {strategies}
"""
OWN_STAGE = '''"""A stage of one's own."""

import numpy as np

from palpate.render.contour_batch import ContourBatch
from palpate.render.stages.registry import register_prune


def renewed_odd(batch, setting):
    """Leave out every other polyline."""
    keep = np.arange(batch.polyline_count) % 2 == 0
    counts, poses = np.diff(batch.polyline_start), np.repeat(np.arange(batch.pose_count), np.diff(batch.pose_start))
    points = np.repeat(keep, counts)
    polylines = np.append(0, np.cumsum(np.bincount(poses[keep], minlength=batch.pose_count)))
    return ContourBatch(
        batch.points[points], batch.kind[points], np.append(0, np.cumsum(counts[keep])), batch.polyline_patch[keep],
        batch.polyline_closed[keep], polylines,
    )


register_prune("renewed-odd", renewed_odd)
'''


def plan(folder, *strategies):
    path = folder / "plan.toml"
    path.write_text(PLAN.format(strategies=json.dumps(strategies)))
    return path


def sweep(*arguments):
    return answer("sweep", "--device", "cpu", "--workers", "1", *arguments)


@pytest.mark.exhaustive
def test_a_stage_of_ones_own_may_have_its_words_changed_and_tells_what_it_removes(tmp_path):
    (tmp_path / "mine.json").write_text(json.dumps({"prune": ["outside", "renewed-odd"], "modules": ["renewed_stage"]}))
    words = [
        *PALPATE,
        "sweep",
        plan(tmp_path, "mine.json"),
        "--device",
        "cpu",
        "--workers",
        "1",
        "--no-figure",
        "--allow-code",
        "--json",
    ]
    told = []
    for text, more in ((OWN_STAGE, []), (OWN_STAGE.replace("Leave", "Drop"), ["--baseline", tmp_path / "old.csv"])):
        (tmp_path / "renewed_stage.py").write_text(text)  # a process of its own, since Python imports a module once
        done = subprocess.run([*words, "--table", tmp_path / f"{'new' if more else 'old'}.csv", *more],
                              capture_output=True, text=True)  # fmt: skip
        assert done.returncode == 0, done.stderr
        told.append(json.loads(done.stdout))
    assert told[1]["poses_rendered"] == 300
    found = told[1]["comparison"]
    assert (found["kept"], found["recipe_count"], found["sources"]) == (True, 1, ["strategy mine.json"])
    removed = load_table(tmp_path / "new.csv")["removed_other_mean"]
    assert removed[0] > 0
    assert load_table(told[1]["poses_table"])["removed_other"].mean(dtype=float) == pytest.approx(removed[0])


LOSSES = {"deleted": Path.unlink, "emptied": lambda path: path.write_bytes(b"")}


@pytest.mark.parametrize(
    ("loss", "name"), [("deleted", "poses.parquet"), ("deleted", "table.csv"), ("emptied", "table.csv")]
)
def test_what_a_store_has_lost_is_written_again(tmp_path, loss, name):
    path = plan(tmp_path, "oc")
    lost = Path(sweep(path, "--no-figure")["store"]) / name
    before = lost.read_bytes()
    LOSSES[loss](lost)
    told = sweep(path, "--no-figure")
    assert told["poses_rendered"] == 0
    assert lost.read_bytes() == before
    assert Path(told["poses_table"]).stat().st_size


def test_a_picture_that_fails_is_told_and_costs_nothing_else(tmp_path, monkeypatch):
    from palpate.render.sweeps.report import figure as figure_module

    def broken(*_, **__):
        raise ValueError("no such glyph\nand more")

    monkeypatch.setattr(figure_module, "sweep_figure", broken)
    done = run("sweep", "--device", "cpu", "--workers", "1", plan(tmp_path, "oc"))
    assert done.exit_code == 0, done.output
    assert "warning: no figure: ValueError: no such glyph" in " ".join(done.stderr.split())
    assert not list((tmp_path / "plan.sweep").glob("summary*"))
