"""The live page in a real browser: what it shows is what the files hold, and it asks nobody else for anything."""

import re
import threading
from contextlib import contextmanager

import numpy as np
import pytest

pytest.importorskip("viser")

from browser import Browser  # after the skip

from palpate.render import ContourFile, exploration, record, render
from palpate.render.view.live.session import view_files

pytestmark = pytest.mark.exhaustive  # a browser that draws in software takes seconds to start
ALLOWED = ("THREE.Clock: This module has been deprecated", "GPU stall due to ReadPixels", "Software WebGL")


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
        browser.wait("document.body.innerText.includes('palpate') && document.querySelector('canvas') !== null")
        yield browser
        assert [error for error in browser.errors if not any(known in error for known in ALLOWED)] == []
        port = address.rsplit(":", 1)[1]
        outside = [url for url in browser.requested if not re.match(rf"(http|ws)://127\.0\.0\.1:{port}|blob:", url)]
        assert outside == []
        assert browser.requested


def go_to(browser, pose):
    """Type a pose's number into the slider's field, as a visitor does."""
    browser.run(
        "(() => { const field = [...document.querySelectorAll('input')].find((one) => one.closest('div')"
        "?.parentElement?.parentElement?.querySelector('[role=slider]') && one.type !== 'hidden');"
        "field.focus(); field.select(); })()"
    )
    browser.call("Input.insertText", text=str(pose))
    browser.press("Enter")
    browser.wait(f"document.body.innerText.includes('{pose} of 0..')")


def click(browser, selector, text):
    """Click the element of a selector that shows a text, with the mouse."""
    found = (
        f"[...document.querySelectorAll('{selector}')].find((one) => (one.value || one.innerText).trim() === '{text}')"
    )
    browser.wait(f"{found} !== undefined")
    browser.run(f"{found}.scrollIntoView({{block: 'center'}})")
    left, top, width, height = browser.run(
        f"(() => {{ const r = {found}.getBoundingClientRect(); return [r.left, r.top, r.width, r.height] }})()"
    )
    browser.drag((left + width / 2, top + height / 2))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    motion = exploration("tube", duration=1.0, seed=1)
    return [render("tube", "palm", motion, name).save(folder / f"{name}.h5") for name in ("cc", "oc")]


def shown_length(browser):
    """Lengths in the row of contours [mm]."""
    row = re.search(r"^contours(.*)$", browser.run("document.body.innerText"), re.MULTILINE)
    return [float(text) for text in re.findall(r"([\d.]+) mm", row[1])]


def reds(pixels):
    """How many pixels are red, also through a pale object."""
    red, green, blue = pixels.astype(int).transpose(2, 0, 1)
    return int(((red - green > 70) & (red - blue > 60) & (red > 140)).sum())


def test_a_file_is_shown_and_scrubbed(tmp_path, files):
    with ContourFile(files[0]) as file:
        length = 1e3 * file.metrics()["length"]
    with opened(tmp_path, files[0]) as browser:
        browser.wait(f"document.body.innerText.includes('{length.argmax()} of 0..89')")  # where it begins
        for pose in (54, 70, 12):
            go_to(browser, pose)
            assert shown_length(browser) == [pytest.approx(length[pose], abs=0.051)]
        pixels = {}
        for pose in (0, 54):  # without contours, and with the longest
            go_to(browser, pose)
            browser.settle(3)
            pixels[pose] = browser.pixels()
    assert length[0] == 0
    assert reds(pixels[54]) > reds(pixels[0]) + 300  # the object's contour; the browser's own notice is red, too
    assert len(np.unique(pixels[54].reshape(-1, 3), axis=0)) > 500  # shaded: object, hand, array


class StopError(Exception):
    """Ends a rendering half way."""


def test_a_file_that_is_still_being_written(tmp_path):
    motion = exploration("tube", duration=60.0, seed=1)
    path = tmp_path / "growing.h5"

    def stop_early(done, total):
        if done:
            raise StopError

    with pytest.raises(StopError):
        record(path, "tube", "palm", motion, "cc", memory=5_000_000, progress=stop_early)
    with opened(tmp_path, path) as browser:
        browser.wait("document.body.innerText.includes('still being written')")
        go_to(browser, 5399)
        browser.wait("document.body.innerText.includes('not rendered yet')")
        record(path, "tube", "palm", motion, "cc", mode="resume")
        browser.wait("!document.body.innerText.includes('still being written')", timeout=30)
        browser.wait("!document.body.innerText.includes('not rendered yet')")
    with ContourFile(path) as file:
        assert file.sealed


def test_a_row_of_a_sweep_opens_as_a_rendering(tmp_path):
    from typer.testing import CliRunner

    from palpate.render.cli.app import app

    (tmp_path / "plan.toml").write_text('[object]\nsource = ["cube", "tube"]\n[motion]\nduration = 0.5\n')
    done = CliRunner().invoke(app, ["sweep", str(tmp_path / "plan.toml"), "--device", "cpu", "--workers", "1", "-q"])
    assert done.exit_code == 0, done.output
    with opened(tmp_path, tmp_path / "plan.sweep") as browser:
        browser.wait("document.body.innerText.includes('2 rows')")
        field = "[...document.querySelectorAll('input')].filter((one) => one.type === 'text').at(-1)"
        browser.run(f"{field}.focus()")
        browser.call("Input.insertText", text="7")
        press = "[...document.querySelectorAll('button')].find((b) => b.innerText === '{}').click()"
        browser.run(press.format("open"))
        browser.wait("document.body.innerText.includes('must be one number of 0..1')")
        browser.run(f"{field}.focus(); {field}.select()")
        browser.call("Input.insertText", text="0,1")
        browser.settle(0.5)
        browser.run(press.format("open"))
        browser.wait("/[0-9]+ of 0\\.\\.44/.test(document.body.innerText)")
        assert "object cube" in browser.run("document.body.innerText")
        browser.run(press.format("back to the table"))
        browser.wait("document.body.innerText.includes('2 rows')")


def test_pressure_and_noise_are_predicted(tmp_path, files):
    with opened(tmp_path, *files) as browser:
        go_to(browser, 54)
        click(browser, "[role=tab], button", "predict")
        click(browser, "input", "off")
        click(browser, "[role=option]", "skin")
        browser.wait("/bright: [0-9.]+ Pa/.test(document.body.innerText)")
        click(browser, "button", "noise around this moment")
        browser.wait("/oc: \\+[0-9.]+ dB\\(A\\)/.test(document.body.innerText)")  # jumps of open lines are louder
        browser.wait("document.body.innerText.includes('noise [dB(A)]')")
        browser.settle(3)
        pixels = browser.pixels()
        (tmp_path / "shot.png").write_bytes(browser.screenshot())
    bright = (pixels[..., 0] > 230) & (pixels[..., 1] > 90) & (pixels[..., 1] < 200) & (pixels[..., 2] < 80)
    assert bright.sum() > 20  # the brightest colours of the print
