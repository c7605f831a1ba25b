"""Commands end with a sentence that says what their numbers mean; tables say values in words, with units."""

import json

import pytest
from command_line import run

from palpate.render import render, static_pose
from palpate.render.cli.prediction_commands import meaning_of


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
def test_a_demonstration_says_how_much_longer_closed_contours_are(tmp_path):
    shown = run("demo", "-o", tmp_path / "d", "--clock", "virtual").stdout.splitlines()
    told = json.loads(run("demo", "-o", tmp_path / "d", "--clock", "virtual", "--overwrite", "--json").stdout)
    assert shown[-1].startswith(
        f"Closed contours (CC) are {told['r']:.2f} times as long as open ones (OC): at the same"
    )


@pytest.mark.exhaustive
def test_json_has_no_sentence_after_it(tmp_path):
    path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "cube.h5")
    json.loads(run("noise", path, "--duration", 0.2, "--json").stdout)
    json.loads(run("play", path, "--duration", 0.2, "--clock", "virtual", "--json").stdout)
