"""The exported page in a real browser, opened from disk: numbers, pictures, keys; nothing leaves the machine."""

import math

import numpy as np
import pytest
import trimesh
from browser import Browser

from palpate.render import ContourFile, HandMotion, MeshObject, exploration, export_page, render, static_pose

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

    def show(files, *, flags=(), prepare=lambda browser: None, begin="Home", **options):
        page = tmp_path / "page.html"
        export_page(files, page, overwrite=True, **options)
        browser = Browser(tmp_path, flags=flags)
        opened.append(browser)
        prepare(browser)
        browser.open(page.as_uri())
        browser.wait("document.querySelector('[data-ready]')")
        if begin:
            browser.press(begin)
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


def test_keys_step_and_play(shown, tube):
    browser = shown(tube)
    pose = f"Number({READOUTS}[0].match(/pose (\\d+)/)[1])"
    for _ in range(3):
        browser.press("ArrowRight")
    assert browser.run(pose) == 3
    browser.press("ArrowLeft")
    assert browser.run(pose) == 2
    browser.press("End")
    assert browser.run(pose) == 99
    browser.press("Home")
    assert browser.run(pose) == 0
    browser.press(" ")
    assert browser.run("document.getElementById('play').textContent") == "Pause"
    browser.wait(f"{pose} > 20")
    browser.press(" ")
    at = browser.run(pose)
    browser.settle(0.5)
    assert browser.run(pose) == at
    browser.press(" ")
    browser.wait(f"{pose} === 99 && document.getElementById('play').textContent === 'Play'")  # it ends by itself
    assert browser.errors == []


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
        drag_time_to(browser, int(first.metrics()["length"][:60].argmax()))
    pixels = scene_of(browser)
    half = pixels.shape[1] // 2
    assert near(pixels[:-40, :half], HAND_BLUE) + near(pixels[:-40, :half], OBJECT_RED) > 50
    assert near(pixels[:-40, half:], MADE_VIOLET) > 50
    assert near(pixels[:-40, :half], MADE_VIOLET) == 0


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


@pytest.mark.filterwarnings("ignore:.*holds no contour")
def test_one_pose_without_time_and_without_contour_is_shown(shown, folder):
    path = render("cube", "palm", static_pose([0, 0, 0.45]), "cc").save(folder / "nothing.h5")
    browser = shown(path)
    assert browser.run(READOUTS) == ["pose 0", "no contour · tilt 0.0°"]
    assert browser.run("document.getElementById('play').disabled")
    assert browser.run("document.getElementById('now').value") == "pose 0"
    assert near(scene_of(browser), OBJECT_RED) == 0
    for key in ("ArrowRight", " ", "Home"):
        browser.press(key)
    assert browser.run(READOUTS)[0] == "pose 0"
    assert browser.errors == []


def test_a_moving_object_moves(shown, folder):
    time = np.arange(30) / 30
    poses = np.zeros((30, 7))
    poses[:, 0], poses[:, 2], poses[:, 6] = 0.1 * time, 0.2, 1.0
    motion = HandMotion(time, np.repeat(static_pose([0, 0, 0.2]).pose, 30, axis=0))
    path = render("cube", "palm", motion, "cc", object_pose=HandMotion(time, poses)).save(folder / "moving.h5")
    browser = shown(path, prepare=lambda b: b.prefer(prefers_reduced_motion="reduce"))
    for layer in ("hand", "skin", "array", "zone", "contours", "focal-point"):
        browser.click(f"input[name=layer-{layer}]")
    middles = []
    for at in (0, 29):
        drag_time_to(browser, at)
        grey = np.abs(scene_of(browser)[100:-60].astype(int) - 255).max(axis=2) > 30
        middles.append(np.flatnonzero(grey.any(axis=0)).mean())
    assert middles[1] - middles[0] > 40  # pixels to the right


JUMP_MAGENTA = (0xD6, 0x28, 0xA0)


def tooltip_at(browser, x, y):
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    browser.settle(0.2)
    return browser.run("document.querySelector('.tooltip:not([hidden])')?.textContent ?? ''")


def test_a_jump_under_the_pointer_is_explained_with_its_length(shown, folder):
    path = render("tube", "palm", exploration("tube", duration=2.0, rate=50.0, seed=3), "oc").save(folder / "open.h5")
    browser = shown(path)
    poses = browser.run("document.getElementById('time').max")
    for pose in range(int(poses)):
        drag_time_to(browser, pose)
        if "jump" in browser.run(READOUTS)[1]:
            break
    browser.click("input[name=layer-focal-point]")
    browser.click("input[name=layer-contours]")
    browser.settle(0.5)
    left, top, *_ = (int(value) for value in browser.box(".scene canvas"))
    rows, columns = np.nonzero(np.abs(scene_of(browser).astype(int) - JUMP_MAGENTA).max(axis=2) <= 70)
    inside = rows < 500  # the legend has the colour, too
    x, y = left + columns[inside][0], top + rows[inside][0]
    words = tooltip_at(browser, int(x), int(y))
    assert "A jump is a step longer than 5 mm" in words
    assert float(words.split(" mm")[0]) > 5
    assert tooltip_at(browser, left + 5, top + 300) == ""


def test_plots_say_what_is_under_the_pointer(shown, tube):
    browser = shown(tube)
    left, top, width, height = browser.box("#plot-length .u-over")
    with ContourFile(tube) as file:
        length, time = 1e3 * file.metrics()["length"], file.motion()["time"]
    words = tooltip_at(browser, left + width / 2, top + height / 2)
    row = int(np.abs(time - float(words.split(" s")[0])).argmin())
    assert f" · {length[row]:.1f} mm" in words
    assert abs(time[row] - time[-1] / 2) < 0.05


def test_pressure_is_a_layer_with_its_scale(shown, tube):
    with ContourFile(tube) as file:
        longest = int(file.metrics()["length"].argmax())
    browser = shown(tube, poses=f"{longest}:{longest + 1}", pressure=True)
    assert "Pa" in browser.run("document.querySelector('.legend').innerText")
    shown_print = scene_of(browser).astype(int)
    browser.click("input[name=layer-pressure]")
    browser.settle(0.5)
    darker = (scene_of(browser).astype(int) - shown_print).max(axis=2) > 40
    assert darker.sum() > 1000  # skin that no sound presses on


def test_keys_hide_layers_change_the_speed_and_list_themselves(shown, tube):
    browser = shown(tube)
    label = "getComputedStyle(document.querySelector('.zone-label')).display"
    assert browser.run("document.querySelector('.zone-label').textContent").startswith("focal zone of emulator: 50 to")
    number = browser.run(
        "[...document.querySelectorAll('.layers input')].findIndex((box) => box.name === 'layer-zone') + 1"
    )
    browser.press(str(number))
    assert browser.run(label) == "none"
    browser.press(str(number))
    assert browser.run(label) != "none"
    browser.press("<")
    assert browser.run("document.getElementById('speed').value") == "2"
    browser.press("?")
    assert browser.run("document.getElementById('help').open")


def test_a_narrow_window_needs_no_scrolling_sideways(shown, tube, hatch):
    for files in ([tube], [tube, hatch]):
        browser = shown(files)
        browser.resize(360, 740, touch=True)
        browser.settle(0.5)
        assert browser.run("document.documentElement.scrollWidth") <= 360
        left, _, width, _ = browser.box("#time")
        assert left >= 0
        assert left + width <= 360
