"""`export_page`: sizes, limits with what would fit, two files, and what is refused."""

import errno
import os
import re

import numpy as np
import pytest
from page_oracle import read_page

from palpate.datasets import static_pose
from palpate.device import array_model
from palpate.render import (
    PlacedArray,
    StrategyError,
    ViewError,
    exploration,
    export_page,
    load_rig,
    render,
)
from palpate.render.view.file_scene import FileScene
from palpate.render.view.page import export as module
from palpate.render.view.pressure_print import PressurePrinter


@pytest.fixture(scope="module")
def tube(tmp_path_factory):
    motion = exploration("tube", duration=0.6, rate=50.0, seed=3)  # 30 poses
    return render("tube", "palm", motion, "cc").save(tmp_path_factory.mktemp("page") / "tube.h5")


def test_the_same_files_give_the_same_bytes(tube, tmp_path):
    pages = [tmp_path / "a.html", tmp_path / "b.html"]
    for page in pages:
        export_page(tube, page, poses=":10")
    assert pages[0].read_bytes() == pages[1].read_bytes()


@pytest.mark.exhaustive
def test_what_would_fit_does_fit(tube, tmp_path):
    page = tmp_path / "tube.html"
    whole = export_page(tube, page)["bytes"]
    one = export_page(tube, page, poses="0:1", overwrite=True)["bytes"]
    limit = one + 2 * (whole - one) // 3
    before = page.read_bytes()
    with pytest.raises(ViewError, match="limit=1 admits it") as refused:
        export_page(tube, page, limit=limit / 1e6, overwrite=True)
    assert page.read_bytes() == before
    message = str(refused.value)
    assert f"would have {whole / 1e6:.3g} MB, and the limit is {limit / 1e6:.3g} MB" in message
    every = int(re.search(r"every=(\d+)", message)[1])
    poses = re.search(r'poses="([\d:]+)"', message)[1]
    assert 2 <= every <= 3
    assert export_page(tube, page, every=every, limit=limit / 1e6, overwrite=True)["poses"][0] == -(-30 // every)
    assert export_page(tube, page, poses=poses, limit=limit / 1e6, overwrite=True)["poses"][0] >= 10


def test_a_page_far_over_the_limit_is_refused_after_a_few_poses(tube, tmp_path, monkeypatch):
    packed = []
    pack = module.pack_file
    monkeypatch.setattr(module, "SAMPLED", 8)
    monkeypatch.setattr(
        module, "pack_file", lambda scene, rows, *a, **k: packed.append(len(rows)) or pack(scene, rows, *a, **k)
    )
    one = export_page(tube, tmp_path / "one.html", poses="0:1")["bytes"]
    packed.clear()
    page = tmp_path / "tube.html"
    with pytest.raises(ViewError, match=r"would have about 0\.\d+ MB.*would fit") as refused:
        export_page(tube, page, limit=(one + 3_000) / 1e6)
    assert packed == [1, 8]
    assert not page.exists()
    every = int(re.search(r"every=(\d+)", str(refused.value))[1])
    assert export_page(tube, page, every=every, limit=(one + 3_000) / 1e6)["poses"][0] >= 3


def test_a_limit_below_the_script_itself_says_so(tube, tmp_path):
    with pytest.raises(ViewError, match=r"none of its poses fits, as every page has 0\.\d+ MB besides"):
        export_page(tube, tmp_path / "tube.html", limit=0.1)


def test_arrays_stand_where_they_are_placed(tube, tmp_path):
    above = PlacedArray(array_model("emulator").placed([0, 0, 0.4, 1, 0, 0, 0]))  # 40 cm up, face down
    export_page(tube, tmp_path / "tube.html", array=[above], poses=":2")
    (array,) = read_page((tmp_path / "tube.html").read_text())["arrays"]
    model = array_model("emulator")
    np.testing.assert_allclose(array["transducers"][:, 2], 0.4, atol=1e-5)
    np.testing.assert_allclose(array["normals"], [[0, 0, -1]] * model.transducer_count, atol=1e-6)
    zone = np.array(array["zone"])
    assert sorted(set(zone[:, 2].round(6))) == pytest.approx(
        [0.4 - model.focal_zone.z_max, 0.4 - model.focal_zone.z_min]
    )
    assert np.abs(zone[:, :2]).min() == pytest.approx(model.focal_zone.lateral)
    spacing = np.abs(model.position[1] - model.position[0]).max()
    assert 0.8 * spacing < 2 * array["radius"] < spacing  # discs do not overlap


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("tube.pdf", r"must end in .html or .htm, not '.pdf'"),
        ("none/tube.html", "there is no folder"),
        (7, "must be a path, not 7"),
    ],
)
def test_places_that_take_no_page_are_refused_before_any_work(tube, tmp_path, out, message, monkeypatch):
    monkeypatch.setattr(module, "FileScene", None)
    with pytest.raises(StrategyError, match=message):
        export_page(tube, tmp_path / out if isinstance(out, str) else out)


def test_a_page_that_is_there_stays(tube, tmp_path):
    page = tmp_path / "tube.html"
    page.write_text("mine")
    with pytest.raises(StrategyError, match="exists; overwrite=True replaces it"):
        export_page(tube, page)
    with pytest.raises(StrategyError, match="one contour file or two, not 3"):
        export_page([tube] * 3, page, overwrite=True)
    assert page.read_text() == "mine"


def test_a_full_disk_leaves_no_page_and_no_rest(tube, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("palpate.datasets.storage.durable.os.write", full)
    with pytest.raises(ViewError, match="the page cannot be written"):
        export_page(tube, tmp_path / "tube.html", poses=":2")
    assert list(tmp_path.iterdir()) == []


class StopError(Exception):
    """Ends a rendering half way."""


def test_an_unfinished_file_is_told_and_refused_where_nothing_is_rendered(tmp_path):
    from palpate.render import ContourFile, record
    from palpate.render.errors import PalpateWarning

    def stop_at_once(done, _):
        if done:
            raise StopError

    path, out = tmp_path / "a.h5", tmp_path / "a.html"
    with pytest.raises(StopError):
        record(path, "tube", "palm", exploration("tube", duration=120.0), "cc", memory=5_000_000, progress=stop_at_once)
    with ContourFile(path) as file:
        done = file.done[0][1]
        assert done < file.pose_count
    with pytest.raises(StrategyError, match="none of the chosen poses is rendered"):
        module.export_page(path, out, poses=f"{done}:", every=500)
    assert not out.exists()
    with pytest.warns(PalpateWarning, match="is not finished"):
        module.export_page(path, out, every=500)
    assert f"unfinished: {done} of 10800 poses are rendered" in out.read_text()


@pytest.mark.exhaustive
def test_pressure_is_that_of_the_printer_and_of_one_scale_for_files_of_the_same_poses(tmp_path):
    paths = [
        render("cube", "palm", static_pose([0, 0.05, 0.2]), name).save(tmp_path / f"{name}.h5") for name in ("cc", "oc")
    ]
    export_page(paths, tmp_path / "page.html", pressure=True)
    packed = [file["pressure"] for file in read_page((tmp_path / "page.html").read_text())["files"]]
    prints = []
    for path in paths:
        with FileScene(path) as scene:
            prints.append(PressurePrinter(load_rig("emulator")).compute(scene.moment(0), "skin"))
    peak = max(each.peak for each in prints)
    for own, printed in zip(packed, prints, strict=True):
        assert own["peak"].tolist() == pytest.approx([peak])
        assert tuple(own["shape"][0]) == printed.on_planes[0].shape
        expected = 255 * printed.on_planes[0].ravel() / peak
        np.testing.assert_allclose(own["values"], expected, atol=0.51)


def test_poses_beyond_the_file_are_refused_with_those_that_it_has(tube, tmp_path):
    with pytest.raises(StrategyError, match=r"poses \d+:\d+ are not all in .*, which has poses 0:\d+$"):
        export_page(tube, tmp_path / "page.html", poses="0:6000")
