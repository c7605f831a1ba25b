"""The served page in a real browser: what it shows is what the files hold, and it asks nobody else for anything."""

import re
import threading
from contextlib import contextmanager

import numpy as np
import pytest
from browser import Browser

from palpate.render import ContourFile, exploration, record, render
from palpate.render.view.served.viewing import view_files

pytestmark = pytest.mark.exhaustive  # a browser that draws in software takes seconds to start
READOUTS = "[...document.querySelectorAll('.readout output')].map((output) => output.value)"


@contextmanager
def served(*paths, **options):
    """The address of a viewer that runs in a thread of its own."""
    ready, stop, found = threading.Event(), threading.Event(), []

    def tell(address):
        found.append(address)
        ready.set()

    def run():
        try:
            view_files(paths, ready=tell, stop=stop, **options)
        except BaseException as error:
            found.append(error)
            ready.set()
            raise

    thread = threading.Thread(target=run)
    thread.start()
    try:
        assert ready.wait(60)
        assert isinstance(found[0], str), found[0]
        yield found[0]
    finally:
        stop.set()
        thread.join(30)
    assert not thread.is_alive()


@contextmanager
def opened(tmp_path, *paths, **options):
    """A browser that shows a viewer's page; afterwards, its console had no error and nobody else was asked."""
    with served(*paths, **options) as address, Browser(tmp_path) as browser:
        browser.open(address)
        browser.wait("document.querySelector('[data-ready]')")
        yield browser
        assert browser.errors == []
        origin = re.match(r"http(://127\.0\.0\.1:\d+/)", address)[1]
        outside = [url for url in browser.requested if not url.startswith((f"http{origin}", f"ws{origin}"))]
        assert outside == []
        assert len(browser.requested) >= 2  # the page, and its WebSocket


def go_to(browser, pose):
    """Drag the slider to a pose, and wait until it is shown."""
    browser.run(
        f"(() => {{ const time = document.getElementById('time'); time.value = {pose};"
        " time.dispatchEvent(new Event('input')) })()"
    )
    browser.wait(f"{READOUTS}[0].startsWith('pose {pose} ')")


def choose(browser, selector, value):
    browser.run(
        f"(() => {{ const box = document.querySelector('{selector}'); box.value = '{value}';"
        " box.dispatchEvent(new Event('change')) })()"
    )


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("served")
    motion = exploration("tube", duration=1.0, seed=1)
    return [render("tube", "palm", motion, name).save(folder / f"{name}.h5") for name in ("cc", "oc")]


def reds(pixels):
    """How many pixels are red, also through a pale object."""
    red, green, blue = pixels.astype(int).transpose(2, 0, 1)
    return int(((red - green > 70) & (red - blue > 60) & (red > 140)).sum())


def test_a_file_is_shown_and_scrubbed(tmp_path, files):
    with ContourFile(files[0]) as file:
        length = 1e3 * file.metrics()["length"]
    pixels = {}
    with opened(tmp_path, files[0]) as browser:
        assert browser.run(READOUTS)[0].startswith(f"pose {length.argmax()} of 0..89")
        for pose in (0, 70, 12, 54):
            go_to(browser, pose)
            shown = browser.run(READOUTS)[1]
            assert shown.startswith(f"{length[pose]:.1f} mm" if length[pose] else "no contour")
            browser.settle(1.0)
            pixels[pose] = browser.pixels()
        browser.press("ArrowRight")
        browser.wait(f"{READOUTS}[0].startsWith('pose 55 ')")
        browser.press("End")
        browser.wait(f"{READOUTS}[0].startsWith('pose 89 ')")
        browser.press("Home")
        browser.wait(f"{READOUTS}[0].startsWith('pose 0 ')")
        browser.press(" ")
        browser.wait(f"Number({READOUTS}[0].match(/pose (\\d+)/)[1]) > 20")  # it plays
    assert reds(pixels[54]) > reds(pixels[0]) + 300  # the object's contour


def test_two_files_stand_side_by_side_with_one_clock(tmp_path, files):
    with opened(tmp_path, *files) as browser:
        go_to(browser, 54)
        lengths = []
        for file in files:
            with ContourFile(file) as read:
                lengths.append(1e3 * float(read.metrics(54, 55)["length"][0]))
        shown = browser.run(READOUTS)
        assert shown[0] == shown[2]
        assert shown[1].startswith(f"{lengths[0]:.1f} mm")
        assert shown[3].startswith(f"{lengths[1]:.1f} mm")
        assert browser.run("[...document.querySelectorAll('.readout b')].map((b) => b.textContent)") == ["cc", "oc"]


def test_pressure_is_predicted(tmp_path, files):
    with opened(tmp_path, *files) as browser:
        go_to(browser, 54)
        before = browser.pixels()
        choose(browser, "#pressure", "skin")
        browser.wait("/[0-9.]+ Pa/.test(document.querySelector('.legend').innerText)")
        browser.settle(1.0)
        pixels = browser.pixels()
        browser.press("ArrowRight")  # a print is of one pose: it goes with the pose, and comes again
        browser.wait("!/Pa/.test(document.querySelector('.legend').innerText)")
        browser.wait("/[0-9.]+ Pa/.test(document.querySelector('.legend').innerText)")
    change = np.abs(pixels.astype(int) - before).max(axis=2)
    assert (change > 40).sum() > 1000  # the print
    bright = [
        ((p[..., 0] > 230) & (p[..., 1] > 90) & (p[..., 1] < 200) & (p[..., 2] < 80)).sum() for p in (before, pixels)
    ]
    assert bright[1] > bright[0] + 20  # its brightest colours


def test_a_file_that_is_still_being_written(tmp_path):
    motion = exploration("tube", duration=60.0, seed=1)
    path = tmp_path / "growing.h5"

    class StopError(Exception):
        pass

    def stop_early(done, total):
        if done:
            raise StopError

    with pytest.raises(StopError):
        record(path, "tube", "palm", motion, "cc", memory=5_000_000, progress=stop_early)
    with opened(tmp_path, path) as browser:
        browser.wait("document.querySelector('.file-name').textContent.includes('unfinished')")
        go_to(browser, 5399)
        assert browser.run(READOUTS)[1] == "not rendered yet"
        record(path, "tube", "palm", motion, "cc", mode="resume")
        browser.wait("document.querySelector('.file-name').textContent === 'growing.h5'", timeout=30)
        browser.wait(f"{READOUTS}[1] !== 'not rendered yet'")


def test_a_row_of_a_sweep_opens_as_a_rendering_and_back_leads_to_the_table(tmp_path):
    from typer.testing import CliRunner

    from palpate.render.cli.app import app

    (tmp_path / "plan.toml").write_text('[object]\nsource = ["cube", "tube"]\n[motion]\nduration = 0.5\n')
    done = CliRunner().invoke(app, ["sweep", str(tmp_path / "plan.toml"), "--device", "cpu", "--workers", "1", "-q"])
    assert done.exit_code == 0, done.output
    with opened(tmp_path, tmp_path / "plan.sweep") as browser:
        browser.wait("document.body.innerText.includes('2 rows')")
        for row in (0, 1):
            browser.click(f".table input[aria-label='row {row}']")
        browser.click(".timeline > button:last-child")
        browser.wait("/pose [0-9]+ of 0\\.\\.44/.test(document.querySelector('.readout')?.innerText)")
        assert "row 0: object cube" in browser.run("document.body.innerText")
        browser.run("history.back()")
        browser.wait("document.querySelector('.table') && document.body.innerText.includes('2 rows')")


def test_the_page_says_when_the_viewer_has_ended(tmp_path, files):
    with Browser(tmp_path) as browser:
        with served(files[0]) as address:
            browser.open(address)
            browser.wait("document.querySelector('[data-ready]')")
        browser.wait("document.body.innerText.includes('The viewer has ended')")
