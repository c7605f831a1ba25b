"""Strategies that change between sweeps: what CI is told; and what a store has lost of its tables is written again."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from command_line import FAILED, PALPATE, answer, run

from palpate.datasets.sweeps.table import load_table
from palpate.render.sweeps.report.results import contactless_text

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


def small(folder, length, **more):
    (folder / "mine.json").write_text(json.dumps({"prune": ["outside", {"stage": "small", "length": length}], **more}))


def test_recipes_with_other_prune_stages_have_one_table_of_poses(tmp_path):
    small(tmp_path, 0.05)
    told = sweep("--no-figure", plan(tmp_path, "mine.json", "oc"))
    poses = load_table(told["poses_table"])
    assert len(poses["pose"]) == 600
    first = poses["recipe"] == 0
    assert np.isfinite(poses["removed_small"]).tolist() == first.tolist()
    assert np.isnan(poses["removed_off_skin"]).all()
    table = load_table(told["table"])
    assert np.mean(poses["removed_small"][first], dtype=float) == pytest.approx(table["removed_small_mean"][0])
    assert table["removed_small_mean"][0] > 0


@pytest.mark.exhaustive
def test_an_edited_strategy_is_compared_with_what_it_was(tmp_path):
    path = plan(tmp_path, "mine.json")
    small(tmp_path, 0.05)
    sweep("--no-figure", path, "--table", tmp_path / "old.csv")
    small(tmp_path, 0.05 + 1e-12)  # harmless
    told = sweep("--no-figure", path, "--baseline", tmp_path / "old.csv")["comparison"]
    assert (told["kept"], told["recipe_count"], told["sources"]) == (True, 1, ["strategy mine.json"])
    small(tmp_path, 0.2)
    found = run("sweep", "--device", "cpu", "--workers", "1", "--no-figure", path, "--baseline", tmp_path / "old.csv")
    assert found.exit_code == FAILED
    said = " ".join(found.stderr.split())
    assert "the file behind this name has changed: strategy mine.json" in said
    assert "removed_small_mean" in said


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


@pytest.mark.exhaustive
def test_a_store_has_the_files_of_its_last_plan_and_writes_them_once(tmp_path):
    path = plan(tmp_path, "oc")
    store = Path(sweep(path)["store"])
    files = [store / name for name in ("table.csv", "poses.parquet", "summary.png", "table.json")]
    before = [file.stat().st_mtime_ns for file in files]
    assert sweep(path).keys() >= {"table", "poses_table", "figure"}
    assert [file.stat().st_mtime_ns for file in files] == before
    told = sweep(path, "--set", "per_pose=false", "--set", "strategy.source=['oc', 'cc']", "--no-figure")
    assert [file.exists() for file in files] == [True, False, False, True]
    assert not {"poses_table", "figure"} & told.keys()
    assert load_table(store / "table.csv")["strategy"].tolist() == ["oc", "cc"]


def test_a_picture_that_fails_is_told_and_costs_nothing_else(tmp_path, monkeypatch):
    from palpate.render.sweeps.report import figure as figure_module

    def broken(*_, **__):
        raise ValueError("no such glyph\nand more")

    monkeypatch.setattr(figure_module, "sweep_figure", broken)
    done = run("sweep", "--device", "cpu", "--workers", "1", plan(tmp_path, "oc"))
    assert done.exit_code == 0, done.output
    assert "warning: no figure: ValueError: no such glyph" in " ".join(done.stderr.split())
    assert not list((tmp_path / "plan.sweep").glob("summary*"))


def test_recipes_without_contact_are_named_because_their_ratios_are_empty():
    lengths = [0.1, 0.0, 0.2, 0.0, None, 0.0, 0.0]
    columns = {"object": [*"abcdefg"], "speed": [7.0] * 7, "recipe_hash": [*"1234567"], "length_mean": lengths}
    text = contactless_text(columns)
    assert "in 4 of 7 recipes the hand never meets the object" in text
    assert "(NaN): b; d; f; and 1 more. object.at moves" in text
    assert contactless_text(columns | {"length_mean": [0.1] * 7}) is None
    assert contactless_text({"recipe_hash": ["1"]}) is None  # no lengths were asked for
