"""Functions that take contour files take batches; what they give is what they give for the file."""

import csv

import numpy as np
import pytest
from matplotlib.image import imread

from palpate.render import (
    draw_figure,
    exploration,
    export_file,
    export_page,
    load_contours,
    play_file,
    predict_noise,
    prepare_frames,
    pressure_metrics,
    render,
    summarise,
)
from palpate.render.contour_input import takes_batches
from palpate.render.errors import StrategyError


@pytest.fixture(scope="module")
def batches(tmp_path_factory):
    """An open and a closed rendering in memory, and the closed one as a file and as a loaded batch."""
    motion = exploration("cube", duration=0.4, seed=1)
    opened, closed = (render("cube", "palm", motion, strategy) for strategy in ("oc", "cc"))
    path = closed.save(tmp_path_factory.mktemp("input") / "cc.h5")
    return opened, closed, path, load_contours(path)


@pytest.mark.exhaustive
def test_a_picture_of_batches_is_the_picture_of_their_files(batches, tmp_path):
    opened, closed, path, loaded = batches
    pictures = []
    for k, pair in enumerate(([opened, closed], [opened, loaded], [opened.save(tmp_path / "oc.h5"), path])):
        draw_figure(pair, tmp_path / f"{k}.png", times=[0.35])
        pictures.append(imread(tmp_path / f"{k}.png"))
    assert pictures[0].std() > 0.05
    assert np.array_equal(pictures[0], pictures[2])
    assert np.array_equal(pictures[1], pictures[2])


@pytest.mark.exhaustive
def test_noise_pressure_and_pages_of_a_batch_are_those_of_its_file(batches, tmp_path, monkeypatch):
    _, closed, path, loaded = batches
    monkeypatch.chdir(tmp_path)
    assert np.array_equal(predict_noise(closed).samples, predict_noise(path).samples)
    assert np.array_equal(loaded.noise().samples, predict_noise(path).samples)
    assert closed.field(poses=2) == loaded.field(poses=2) == pressure_metrics(path, poses=2)
    assert export_page(closed, "a.html")["poses"] == export_page([path], "b.html")["poses"]


@pytest.mark.exhaustive
def test_numbers_tables_and_playbacks_of_a_batch_are_those_of_its_file(batches, tmp_path, monkeypatch):
    _, closed, path, loaded = batches
    monkeypatch.chdir(tmp_path)
    names = ("poses", "polylines", "points", "length_mean", "draw_frequency", "strategy")
    assert [summarise(closed)[name] for name in names] == [summarise(path)[name] for name in names]
    tables = []
    for k, source in enumerate((closed, loaded, path)):
        export_file(source, f"{k}.csv")
        tables.append([row for row in csv.reader((tmp_path / f"{k}.csv").read_text().splitlines()) if len(row) > 1])
    assert tables[0] == tables[1] == tables[2]
    assert len(tables[0]) > 10
    played = [play_file(source, clock="virtual").reports[0].frames for source in (closed, path)]
    assert played[0] == played[1] > 1000
    assert prepare_frames(closed, "a.h5").frames == played[0]


def test_a_batch_without_object_cannot_be_a_file_and_the_error_says_so(batches):
    with pytest.raises(StrategyError, match=r"a part of .*: save or draw the whole"):
        draw_figure([batches[3][:5]], "never.png")


def test_a_batch_is_a_file_only_while_the_function_runs(batches):
    seen = []

    @takes_batches
    def note(paths, word):
        seen.extend(paths.values())
        assert all(path.is_file() for path in paths.values())
        return word

    assert note(paths={"a": batches[1]}, word="given by name") == "given by name"
    assert note({"b": batches[0]}, "given in order") == "given in order"
    assert len(seen) == 2
    assert not any(path.exists() for path in seen)
