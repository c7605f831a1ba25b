"""The exported page in a real browser, opened from disk: numbers, pictures, keys; nothing leaves the machine."""

import math

import numpy as np
import pytest
import trimesh
from browser import Browser

from palpate.render import ContourFile, MeshObject, exploration, export_page, render, static_pose

pytestmark = pytest.mark.exhaustive

OBJECT_RED, HAND_BLUE, MADE_VIOLET = (0xB1, 0x12, 0x1F), (0x3D, 0x9B, 0xE0), (0x6A, 0x4C, 0x93)
READOUTS = "[...document.querySelectorAll('.readout output')].map((output) => output.value)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def tube(folder):
    motion = exploration("tube", duration=2.0, rate=50.0, seed=3)
    return render("tube", "palm", motion, "cc").save(folder / "tube.h5")


@pytest.fixture(scope="module")
def hatch(folder):
    motion = exploration("tube", duration=1.2, rate=25.0, seed=3)  # another clock, and shorter
    return render("tube", "palm", motion, "hatch").save(folder / "hatch.h5")


@pytest.fixture
def shown(tmp_path):
    """Opens files as a page: the browser, when all is drawn."""
    opened = []

    def show(files, **options):
        page = tmp_path / "page.html"
        export_page(files, page, overwrite=True, **options)
        browser = Browser(tmp_path)
        opened.append(browser)
        browser.open(page.as_uri())
        browser.wait("document.querySelector('[data-ready]')")
        browser.press("Home")
        browser.settle(0.5)
        assert browser.errors == []
        assert browser.requested == [page.as_uri()]
        return browser

    yield show
    for browser in opened:
        browser.close()


def drag_time_to(browser, at):
    browser.run(
        f"(() => {{ const time = document.getElementById('time'); time.value = {at};"
        " time.dispatchEvent(new Event('input')) })()"
    )
    browser.settle(0.3)


def near(pixels, colour, off=6):
    """How many pixels of a picture have a colour."""
    return int((np.abs(pixels.astype(int) - colour).max(axis=2) <= off).sum())


def scene_of(browser):
    left, top, width, height = (int(value) for value in browser.box(".scene canvas"))
    return browser.pixels()[top : top + height, left : left + width]


def numbers_text(file, pose):
    """What the page must say of a pose, from the file's own numbers."""
    length = float(file.metrics(pose, pose + 1)["length"][0])
    time = file.motion(pose, pose + 1)["time"][0]
    samples = math.ceil(10_000 * length / 7.0)  # of a cycle at 10 kHz and 7 m/s
    drawn = f"{1e3 * length:.1f} mm · {10_000 / samples:.1f} Hz" if length > 0 else "no contour"
    return f"pose {pose} of 0..{file.pose_count - 1} · {time:.3f} s", drawn


def test_each_pose_has_the_numbers_of_the_file(shown, tube):
    browser = shown(tube)
    with ContourFile(tube) as file:
        for pose in (0, 17, 63, 99):
            drag_time_to(browser, pose)
            which, drawn = numbers_text(file, pose)
            said = browser.run(READOUTS)
            assert said[0] == which
            assert said[1].startswith(f"{drawn} · tilt ")
    assert browser.errors == []
    assert len(browser.requested) == 1


def test_contours_are_drawn_in_their_colours_and_layers_hide_them(shown, tube):
    browser = shown(tube)
    with ContourFile(tube) as file:
        metrics = file.metrics()
    both = np.minimum(metrics["length_object"], metrics["length_hand"])
    drag_time_to(browser, int(both.argmax()))
    pixels = scene_of(browser)
    assert near(pixels, OBJECT_RED) > 100
    assert near(pixels, HAND_BLUE) > 100
    assert near(pixels, MADE_VIOLET) == 0
    browser.click("input[name=layer-contours]")
    browser.settle(0.5)
    hidden = scene_of(browser)
    assert near(hidden, OBJECT_RED) < 60  # the legend's line
    assert near(hidden, HAND_BLUE) < 60
    for layer in ("object", "hand", "skin", "array", "zone", "focal-point", "jumps"):
        if browser.run(f"document.querySelector('input[name=layer-{layer}]') !== null"):
            browser.click(f"input[name=layer-{layer}]")
    browser.settle(0.5)
    middle = scene_of(browser)[100:-60]
    assert (middle > 250).all()  # nothing is left but paper


def test_two_files_have_one_clock(shown, tube, hatch):
    browser = shown([tube, hatch])
    with ContourFile(tube) as first, ContourFile(hatch) as second:
        for at in (10, 37, 99):
            drag_time_to(browser, at)
            time = first.motion(at, at + 1)["time"][0]
            pose = int(np.searchsorted(second.motion()["time"], time, side="right")) - 1
            said = browser.run(READOUTS)
            assert said[0] == numbers_text(first, at)[0]
            assert said[2] == numbers_text(second, pose)[0]
            assert said[1].startswith(numbers_text(first, at)[1])
            assert said[3].startswith(numbers_text(second, pose)[1])


def test_without_webgl_a_sentence_stands_instead_and_numbers_work(tmp_path, tube):
    export_page(tube, tmp_path / "page.html")
    with Browser(tmp_path, flags=["--disable-3d-apis"]) as browser:
        browser.open((tmp_path / "page.html").as_uri())
        browser.wait("document.querySelector('[data-ready]')")
        assert "cannot draw in three dimensions" in browser.run("document.querySelector('.scene').innerText")
        browser.press("Home")
        browser.press("ArrowRight")
        with ContourFile(tube) as file:
            assert browser.run(READOUTS)[0] == numbers_text(file, 1)[0]
        browser.press(" ")
        browser.wait(f"!{READOUTS}[0].startsWith('pose 1 ')")


def test_foreign_names_are_shown_and_nothing_in_them_runs(shown, folder):
    name = "</script><script>window.obeyed=1</script><img src=x onerror='window.obeyed=1'>\u202e"
    mesh = MeshObject(trimesh.creation.box((0.1, 0.1, 0.1)), at=(0, 0, 0.2), name=name)
    path = render(mesh, "palm", static_pose([0, 0, 0.2]), "cc").save(folder / "<b onclick=x>.h5")
    browser = shown(path, title=name)
    assert browser.run("typeof window.obeyed") == "undefined"
    text = browser.run("document.body.innerText")
    assert name.replace("\u202e", "\\u202e") in text
    assert "<b onclick=x>.h5" in text
    assert browser.run("document.querySelectorAll('img, b[onclick]').length") == 0
    assert browser.run("document.title") == name.replace("\u202e", "\\u202e")


def test_the_page_runs_no_other_script_and_connects_nowhere(shown, tube):
    browser = shown(tube)
    browser.run(
        "(() => { const s = document.createElement('script'); s.textContent = 'window.other = 1';"
        " document.body.append(s) })()"
    )
    assert browser.run("typeof window.other") == "undefined"
    assert browser.run("fetch('http://127.0.0.1:9/x').then(() => 'went', () => 'refused')") == "refused"
    assert any("Content Security Policy" in error for error in browser.errors)
