"""The exported page in a real browser, opened from disk: numbers, pictures, keys; nothing leaves the machine."""

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
    drawn = f"{1e3 * length:.1f} mm · {7.0 / length:.1f} Hz" if length > 0 else "no contour"
    return f"pose {pose} of 0..{file.pose_count - 1} · {time:.3f} s", drawn


def test_each_pose_has_the_numbers_of_the_file(shown, tube):
    browser = shown(tube)
    with ContourFile(tube) as file:
        for pose in (0, 1, 17, 42, 63, 99):
            drag_time_to(browser, pose)
            which, drawn = numbers_text(file, pose)
            said = browser.run(READOUTS)
            assert said[0] == which
            assert said[1].startswith(f"{drawn} · tilt ")
    assert browser.errors == []
    assert len(browser.requested) == 1


def test_a_page_begins_at_the_longest_contours(shown, tube):
    browser = shown(tube, begin=None)
    with ContourFile(tube) as file:
        assert browser.run(READOUTS)[0] == numbers_text(file, int(file.metrics()["length"].argmax()))[0]


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


def test_the_space_bar_plays_also_after_the_slider_was_used(shown, tube):
    browser = shown(tube)
    browser.click("#time")
    at = browser.run("Number(document.getElementById('time').value)")
    assert abs(at - 49.5) <= 2
    browser.press("ArrowRight")  # one pose, by the slider and not by the page as well
    assert browser.run("Number(document.getElementById('time').value)") == at + 1
    browser.press(" ")
    assert browser.run("document.getElementById('play').textContent") == "Pause"
    browser.click("input[name=layer-object]")
    browser.press(" ")  # of the box
    assert browser.run("document.querySelector('input[name=layer-object]').checked")


def test_play_takes_as_long_as_the_motion_did(shown, tube):
    browser = shown(tube)
    seconds = browser.run(
        "new Promise((resolve) => { const begin = performance.now(); document.getElementById('play').click();"
        " const look = () => document.getElementById('play').textContent === 'Play'"
        " ? resolve((performance.now() - begin) / 1000) : requestAnimationFrame(look); look() })"
    )
    assert 1.9 < seconds < 6.0  # frames that take over 0.1 s slow it down: software draws here


def test_a_click_on_a_plot_and_a_drag_move_the_time(shown, tube):
    browser = shown(tube)
    left, top, width, height = browser.box("#plot-length .u-over")
    browser.drag((left + 0.5 * width, top + height / 2))
    assert abs(browser.run("Number(document.getElementById('time').value)") - 49.5) <= 1.5
    left, top, width, height = browser.box("#plot-tilt .u-over")
    browser.drag((left + 0.1 * width, top + 20), (left + 0.4 * width, top + 20), (left + 0.8 * width, top + 30))
    assert abs(browser.run("Number(document.getElementById('time').value)") - 79.2) <= 1.5
    line, _, _, _ = browser.box("#plot-length .now")
    assert abs(line - (left + 0.8 * width)) < 3


def test_plots_show_the_lengths(shown, tube):
    browser = shown(tube)
    with ContourFile(tube) as file:
        length = file.metrics()["length"]
    drag_time_to(browser, int(length.argmax()))
    assert browser.run("document.querySelector('#plot-length output').value") == f"{1e3 * length.max():.1f} mm"
    left, top, width, height = (int(value) for value in browser.box("#plot-length .u-over"))
    dark = near(browser.pixels()[top : top + height, left : left + width], (0x2B, 0x2D, 0x42), 40)
    assert dark > width / 2  # a line from side to side


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


def test_both_views_have_one_camera(shown, tube):
    browser = shown([tube, tube], prepare=lambda b: b.prefer(prefers_reduced_motion="reduce"))
    drag_time_to(browser, 40)

    def halves():
        pixels = scene_of(browser)[90:-40].astype(int)
        half = pixels.shape[1] // 2
        return pixels[:, 5 : half - 5], [
            pixels[:, half + 5 + k : 2 * half - 5 + k] for k in (0, 1)
        ]  # half may be rounded

    left, rights = halves()
    before = left
    assert min(((np.abs(left - right).max(axis=2) > 60).mean()) for right in rights) < 0.002
    x, y, width, height = browser.box(".scene canvas")
    places = [(0.7, 0.6), (0.75, 0.5), (0.85, 0.4)]
    browser.drag(*((x + across * width, y + down * height) for across, down in places))
    browser.settle(0.5)
    left, rights = halves()
    assert min(((np.abs(left - right).max(axis=2) > 60).mean()) for right in rights) < 0.002
    assert (np.abs(left - before).max(axis=2) > 30).mean() > 0.05  # it has turned


def test_the_focal_point_moves_unless_the_visitor_wants_no_motion(shown, tube):
    moving = shown(tube)
    with ContourFile(tube) as file:
        pose = int(file.metrics()["length"].argmax())
    drag_time_to(moving, pose)
    first = scene_of(moving)
    moving.settle(0.7)
    assert (first != scene_of(moving)).any()
    still = shown(tube, prepare=lambda browser: browser.prefer(prefers_reduced_motion="reduce"))
    drag_time_to(still, pose)
    first = scene_of(still)
    still.settle(0.7)
    assert (first == scene_of(still)).all()


def test_slow_motion_goes_from_one_to_a_thousand(shown, tube):
    browser = shown(tube)
    for value, text in ((0, "1:1"), (1, "1:10"), (3, "1:1000")):
        browser.run(
            f"(() => {{ const s = document.getElementById('slowness'); s.value = {value};"
            " s.dispatchEvent(new Event('input')) })()"
        )
        assert browser.run("document.getElementById('slowness-shown').value") == text
    browser.settle(0.3)
    assert browser.errors == []


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


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1920, 1080), (900, 700), (390, 844), (320, 568)])
@pytest.mark.parametrize("count", [1, 2])
def test_parts_stand_side_by_side_at_any_width(shown, tube, hatch, width, height, count):
    browser = shown([tube, hatch][:count], prepare=lambda b: b.resize(width, height, touch=width < 700))
    assert browser.run("document.documentElement.scrollWidth") <= width
    if width >= 900:
        assert browser.run("document.documentElement.scrollHeight") <= height  # all is seen at once
    browser.run("window.scrollTo(0, document.body.scrollHeight)")
    selectors = ["header", ".scene", ".layers", "#plot-length", "#plot-draw_frequency", "#plot-tilt", "footer"]
    selectors += [".timeline"] if width >= 900 else []  # elsewhere it stays at the window's lower edge
    boxes = {name: browser.box(name) for name in selectors}
    for name, (left, top, w, h) in boxes.items():
        assert w > 100 and h > 10, name  # noqa: PT018
        assert left >= 0 and left + w <= width + 1, name  # noqa: PT018
        for other, (left2, top2, w2, h2) in boxes.items():
            across = min(left + w, left2 + w2) - max(left, left2)
            along = min(top + h, top2 + h2) - max(top, top2)
            assert name == other or across <= 0.5 or along <= 0.5, (name, other)
    assert boxes[".scene"][3] >= 250


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


def test_beside_a_file_without_times_the_clock_counts_poses(shown, folder, tube):
    still = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(folder / "still.h5")
    browser = shown([still, tube])
    drag_time_to(browser, 63)
    said = browser.run(READOUTS)
    assert said[0] == "pose 0"
    assert said[1].startswith("340.0 mm · 20.6 Hz")  # four sides of 85 mm, at 7 m/s
    with ContourFile(tube) as file:
        assert said[2] == numbers_text(file, 63)[0]
    assert browser.run("document.getElementById('now').value") == "pose 63"


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
