"""A first try without placement: what its empty file costs, what the command says, and a preview that shows it."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from palpate.datasets.motions.hand_motion import HandMotion
from palpate.render import ContourFile, ContourFileError, record, render, static_pose
from palpate.render.cli.contour_options import ViewCommand
from palpate.render.intersection.file_recording import polylines_in


@pytest.fixture
def motion(tmp_path):
    pose = np.tile(static_pose([0.0, 0.0, 0.2]).pose, (3, 1))
    path = tmp_path / "still.csv"
    HandMotion(np.array([0.0, 0.1, 0.2]), pose).save(path)
    return path


@pytest.mark.exhaustive
def test_an_empty_file_is_replaced_and_one_with_contours_never_by_an_empty_result(tmp_path, motion):
    out = tmp_path / "cube.h5"
    first = run("render", "cube", motion, "-o", out, "--at", 1, 0, 0.2)
    assert first.exit_code == 0
    warning = " ".join(first.stderr.split())
    assert re.search(r"0\.935 m from it at the nearest", warning), warning  # 1 m to the middle less half of 130 mm
    assert "--at 0 0 0.2 moves the object into the middle of the motion" in warning
    assert warning.endswith("The same command replaces this empty file")
    second = run("render", "cube", motion, "-o", out, "--at", 0, 0, 0.2)
    assert (second.exit_code, second.stderr) == (0, "")
    with ContourFile(out) as file:
        drawn = file.polyline_count
    assert drawn == 3
    third = run("render", "cube", motion, "-o", out, "--at", 1, 0, 0.2)
    assert third.exit_code != 0
    assert "exists already" in third.stderr
    fourth = run("render", "cube", motion, "-o", out, "--at", 1, 0, 0.2, "--overwrite")
    assert fourth.exit_code == 1
    assert "stays as it is, with its 3 polylines" in " ".join(fourth.stderr.split())
    with ContourFile(out) as file:
        assert file.polyline_count == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cube.h5", "still.csv"]


class StoppedError(Exception):
    pass


def test_an_empty_rendering_replaces_no_contours_when_it_is_resumed_or_saved(tmp_path):
    """The first run is stopped after its first poses, all of which are empty, too."""
    pose = np.tile(static_pose([0.0, 0.0, 0.9]).pose, (40_000, 1))
    away = HandMotion(np.arange(len(pose)) / 100, pose)
    out = render("cube", "palm", static_pose([0.0, 0.0, 0.2])).save(tmp_path / "cube.h5")

    def stop(done, total):
        if 0 < done < total:
            raise StoppedError

    with pytest.raises(StoppedError):
        record(out, "cube", "palm", away, mode="overwrite", memory=64 << 20, progress=stop)
    assert (tmp_path / "cube.h5.partial").is_dir()
    with pytest.raises(ContourFileError, match=r"stays as it is, with its 1 polylines, .* 0\.635 m from it"):
        record(out, "cube", "palm", away, mode="resume")
    with pytest.raises(ContourFileError, match="stays as it is, with its 1 polylines"):
        render("cube", "palm", away[:2]).save(out, overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["cube.h5"]
    assert polylines_in(out) == 1
    assert record(out, "cube", "palm", static_pose([0.0, 0.0, 0.2]), mode="resume").rendered == 0  # complete


def test_other_files_are_not_taken_for_empty_ones(tmp_path, motion):
    out = tmp_path / "notes.h5"
    out.write_bytes(b"my notes")
    assert run("render", "cube", motion, "-o", out).exit_code != 0
    assert out.read_bytes() == b"my notes"
    empty = render("cube", "palm", static_pose([1.0, 0, 0.2]), "oc")
    empty.save(tmp_path / "batch.h5")
    empty.save(tmp_path / "batch.h5")  # nothing is lost


def test_placement_belongs_to_a_preview(tmp_path):
    refused = run("view", tmp_path / "a.h5", "--at", 0, 0, 0.2)
    assert refused.exit_code == 2
    assert "are of a preview: OBJECT MOTION" in " ".join(refused.stderr.split())


def test_all_motions_that_render_takes_are_of_a_preview():
    """The suffixes that recordings have by docs/formats/recordings.md, a CSV of poses, and the word."""
    for motion in ("a.csv", "a.json", "a.npz", "a.jsonl", "a.ndjson", "a.json.lz", "exploration"):
        assert ViewCommand(files=[Path("cube"), Path(motion)]).is_preview, motion
    assert not ViewCommand(files=[Path("a.h5"), Path("b.h5")]).is_preview
