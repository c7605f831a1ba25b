"""`palpate field`, `palpate noise` and `palpate info --pressure`: numbers, pictures, arrays, refusals."""

import json

import numpy as np
import pytest
from command_line import MISUSED, answer, refused, run

from palpate.render import HandMotion, Palm, StrategyError, radiation_pressure, render, static_pose
from palpate.render.cli.contour_options import FieldCommand
from palpate.render.cli.prediction_commands import meaning_of


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    batch = render("cube", Palm(), static_pose([0.0, 0.06, 0.2]), "oc")
    return batch.save(tmp_path_factory.mktemp("field") / "still.h5")


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    pose = np.tile(static_pose([0, 0.05, 0.2]).pose, (9, 1))
    pose[:, 1] += np.linspace(0, 0.02, 9)
    batch = render("cube", Palm(), HandMotion(time=np.arange(9) / 90, pose=pose), "cc")
    return batch.save(tmp_path_factory.mktemp("field") / "moving.h5")


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    "asked", [(("palm", "npz"), ("volume", "npz")), (("palm", "png"), ("plane", "svg"), ("volume", "png"))], ids=str
)
def test_field_reports_draws_and_writes(asked, moving, tmp_path):
    for where, suffix in asked:
        out = tmp_path / f"{where}.{suffix}"
        average = "instant" if suffix == "npz" else "cycle"
        places = ("--at", 0.05, "--where", where, "--average", average, "--spacing", 0.006)
        values = answer("field", moving, *places, "-o", out)
        assert out.stat().st_size > 1000
        assert 2500 < values["pressure_peak"] < 6000
        assert (values["pose"], values["where"], values["out"]) == (4, where, str(out))
        if where != "volume":
            assert values["share_on_contour"] is None or values["share_on_contour"] > 0.5
            assert values["force"] > 0
    if asked[0][1] != "npz":
        return
    with np.load(tmp_path / "palm.npz") as file:
        kept = dict(file)
    assert kept["points"].shape == (len(kept["radiation"]), 3)
    assert radiation_pressure(kept["pressure"]) == pytest.approx(kept["radiation"], rel=1e-3, abs=1e-3)
    with np.load(tmp_path / "volume.npz") as file:
        assert file["radiation"].shape == (20, 20, 20)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--at", "7"], "at must lie in"),
        (["--at", "0", "--pose", "1"], "exclude each other"),
        (["--where", "moon"], "where must be"),
        (["--average", "year"], "average must be"),
        (["--size", "0.1"], "are of a plane or volume"),
        (["--where", "plane", "--centre", "0", "0", "0.001"], "from a transducer's face"),
        (["-o", "print.txt"], "must end in one of"),
        (["--pose", "99"], "pose must lie in"),
        (["--resonance", "1"], "pole must lie in"),
        (["--width", "single"], "--width is of a picture: add -o PICTURE"),
        (["-o", "a.npz", "--font-size", "8"], "--font-size is of a picture"),
        (["-o", "a.png", "--width", "9"], "width must lie in 0.06..0.6 m"),
        (["-o", "a.png", "--font-size", "0"], "font size must lie in 4..14 points"),
    ],
)
def test_field_refuses_what_it_cannot_do(words, message, moving):
    refused(MISUSED, message, "field", moving, *words)


@pytest.mark.exhaustive
def test_a_pair_is_drawn_in_one_picture_and_reported_file_by_file(still, moving, tmp_path):
    out = tmp_path / "pair.svg"
    coarse = ("--spacing", 0.006)
    alone = [answer("field", path, *coarse) for path in (still, moving)]
    found = answer("field", still, moving, *coarse, "-o", out, "--width", "double", "--font-size", 7)
    assert [own | {"out": None} for own in found["files"]] == alone
    content = out.read_text()
    assert content.count("focal width ") == 2
    assert "still, pose 0, palm" in content
    refused(MISUSED, "numbers are those of one file", "field", still, moving, "-o", tmp_path / "pair.npz")
    refused(MISUSED, "up to 4 files", "field", *[still] * 5)


def test_a_picture_is_not_overwritten_unasked(tmp_path):
    (tmp_path / "there.png").write_bytes(b"")
    with pytest.raises(StrategyError, match="exists"):
        FieldCommand(files=[], out=tmp_path / "there.png").judge()


def test_info_has_pressure_when_asked(still):
    values = answer("info", still, "--pressure")
    assert values["pressure"]["poses"] == 1
    assert values["pressure"]["focus_pressure"] > 2500
    refused(MISUSED, "--pressure is of contour files", "info", "cube", "--pressure")


def row(path, dba, low=0.0):
    return {"path": path, "difference": {"dba": dba, "db_40_300": low}}


def test_levels_of_two_files_are_compared_and_one_alone_is_no_level():
    assert meaning_of([row("a.h5", 0.0), row("b.h5", 5.53, 0.18), row("c.h5", -2.04, -1.0)]) == (
        "Beside a.h5, b.h5 is 5.5 dB louder to the ear (40 to 300 Hz: +0.2 dB), "
        "c.h5 is 2.0 dB quieter to the ear (40 to 300 Hz: -1.0 dB)."
    )
    assert "name a second file" in meaning_of([row("a.h5", 0.0)])
    assert "without sound" in meaning_of([row("a.h5", 0.0), row("b.h5", float("nan"))])


@pytest.mark.exhaustive
def test_json_has_no_sentence_after_it(tmp_path):
    path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "cube.h5")
    json.loads(run("noise", path, "--duration", 0.2, "--json").stdout)
    json.loads(run("play", path, "--duration", 0.2, "--clock", "virtual", "--json").stdout)
