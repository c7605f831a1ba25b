"""A study's two pages in a real browser: a scripted study by keys alone, what is seen of object and hand, and stop."""

import json
import re
import time
from contextlib import contextmanager

import numpy as np
import pytest
from browser import Browser
from page_oracle import elements_of, text_of
from study_cases import (
    AGE,
    ARROWS,
    CHOICE,
    POSE,
    SCALE,
    SCALE_KEYS,
    SPACE,
    WORDS,
    moment_at,
    scene_around,
    served_study,
    show_object,
    square_hand,
    visit,
    wait_until,
)

from palpate.render.errors import StrategyError
from palpate.render.study.pages.study_server import EXPERIMENTER, PARTICIPANT
from palpate.render.study.run.desk import KeyChoice

BEHIND = POSE + np.float32([0.03, 0.08, 0.03, 0, 0, 0, 0])
"""Half of the square hand is hidden by the cube, half of it is seen beside it."""


def page_of(server, path):
    """The HTML of a page."""
    import urllib.request

    with urllib.request.urlopen(server.address(path)) as answer:
        return answer.read().decode()


def test_both_pages_have_addresses_and_say_which_they_are():
    with served_study(language="de", lost="Verbindung <weg>", title="Dichte & Form") as (_, server):
        pages = {path: page_of(server, path) for path in (PARTICIPANT, EXPERIMENTER)}
    described = {path: json.loads(text_of(page, "described")) for path, page in pages.items()}
    assert described[PARTICIPANT] == {"served": True, "page": "participant", "lost": "Verbindung <weg>"}
    assert described[EXPERIMENTER]["page"] == "experimenter"
    languages = [next(own["lang"] for tag, own, _ in elements_of(page) if tag == "html") for page in pages.values()]
    assert languages == ["de", "en"]
    assert "<title>Dichte &amp; Form</title>" in pages[PARTICIPANT]


def test_a_language_is_text_and_nothing_else():
    with served_study(language='de"><script>') as (_, server):
        page = page_of(server, PARTICIPANT)
    assert next(own for tag, own, _ in elements_of(page) if tag == "html") == {"lang": 'de"><script>'}


def test_a_port_that_cannot_be_is_refused():
    with pytest.raises(StrategyError, match="port must be 1 to 65535, not 0"), served_study(port=0):
        pass


@contextmanager
def opened(tmp_path, path=PARTICIPANT, **options):
    """A desk, its server, and a browser with a page of it; afterwards its console had no error."""
    with served_study(**options) as (desk, server), Browser(tmp_path) as browser:
        browser.open(server.address(path))
        browser.wait("document.querySelector('main')")
        yield desk, server, browser
        assert browser.errors == []
        origin = re.match(r"http(://127\.0\.0\.1:\d+/)", server.address())[1]
        assert [url for url in browser.requested if not url.startswith((f"http{origin}", f"ws{origin}"))] == []


def show(desk, browser, kind, text, **fields):
    """Show a screen and wait until it is painted; its number."""
    number = desk.show(kind, text, **fields).number
    browser.wait(f"document.getElementById('page').dataset.number === '{number}'", timeout=20)
    browser.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return number


def type_words(browser, words):
    """Press the key of each character, then Enter."""
    for key in words:
        browser.press(key)
    browser.press("Enter")


def response_of(desk, browser, *keys, seconds=10):
    """The response after these keys; the browser goes on meanwhile."""
    for key in keys:
        browser.press(key)
    assert wait_until(lambda: desk._response is not None, seconds)
    return desk.await_response(0)


@pytest.mark.exhaustive
def test_a_whole_study_is_answered_by_keys_alone(tmp_path):
    with opened(tmp_path) as (desk, _, browser):
        show(desk, browser, "text", "Welcome", title="Before", hint="Press the space bar.", keys=SPACE)
        assert browser.run("document.querySelector('main').innerText").split("\n")[0] == "Welcome"
        assert response_of(desk, browser, " ").key == " "
        for key, value in (("ArrowLeft", 0), ("ArrowRight", 1)):
            show(desk, browser, "question", CHOICE.text, keys=ARROWS, question=CHOICE)
            labels = browser.run("[...document.querySelectorAll('.keys li span')].map((own) => own.textContent)")
            assert labels == ["First", "Second"]  # as the keys lie, and not as they are listed
            assert response_of(desk, browser, key).value == value
            browser.wait(f"document.querySelector('li[data-key={key}].pressed')")
        show(desk, browser, "question", SCALE.text, keys=SCALE_KEYS[::-1], question=SCALE)
        caps = "[...document.querySelectorAll('.keys kbd')].map((own) => own.textContent)"
        assert browser.run(caps) == list("1234567")
        assert browser.run("document.querySelector('.ends').innerText.split(/\\s*\\n\\s*/)") == [
            "not at all",
            "completely",
        ]
        assert response_of(desk, browser, "6").value == 6
        show(desk, browser, "question", AGE.text, question=AGE, refusal="From 18 to 99, please.")
        type_words(browser, "7")
        browser.wait("document.querySelector('.alert:not([hidden])')?.textContent === 'From 18 to 99, please.'")
        assert desk.await_response(0) is None
        assert response_of(desk, browser, "7", "Enter").value == 77
        show(desk, browser, "question", WORDS.text, question=WORDS)
        type_words(browser, "softer 1")
        assert response_of(desk, browser).value == "softer 1"
        show(desk, browser, "rest", "The array rests.", ends=time.monotonic() + 30)
        assert 27 <= int(browser.run("document.querySelector('.rest').textContent")) <= 30
        show(desk, browser, "ended", "Thank you.", progress=1.0)
        assert browser.run("document.querySelector('progress').value") == 1
        assert desk.extra_presses == 0


@pytest.mark.exhaustive
def test_an_empty_answer_and_a_decimal_comma_are_what_they_mean(tmp_path):
    from dataclasses import replace

    with opened(tmp_path) as (desk, _, browser):
        show(desk, browser, "question", "?", question=replace(AGE, is_optional=True))
        assert response_of(desk, browser, "Enter").value is None
        show(desk, browser, "question", "?", question=AGE)
        assert response_of(desk, browser, *"20", ",", "5", "Enter").value == 20.5
        show(desk, browser, "question", "?", question=AGE)
        for typed in ("x", "1,000", "0x20", "1e999"):
            browser.run("document.querySelector('input').value = ''")
            type_words(browser, typed)
            told = f"must be a number, not {typed!r}"
            browser.wait(f"document.querySelector('.alert:not([hidden])')?.textContent.endsWith({told!r})", timeout=10)
        assert desk.await_response(0) is None


@pytest.mark.exhaustive
def test_a_key_pressed_twice_counts_once_and_neither_repeats_nor_shortcuts_count(tmp_path):
    with opened(tmp_path) as (desk, _, browser):
        show(desk, browser, "question", "?", keys=ARROWS, question=CHOICE)
        key = {"key": "ArrowRight", "code": "ArrowRight", "windowsVirtualKeyCode": 39}
        browser.call("Input.dispatchKeyEvent", type="keyDown", autoRepeat=True, **key)
        for modifier in (1, 2, 4):  # alt, control, meta
            browser.call("Input.dispatchKeyEvent", type="rawKeyDown", modifiers=modifier, **key)
        browser.settle(0.3)
        assert (desk.await_response(0), desk.extra_presses) == (None, 0)
        assert response_of(desk, browser, "ArrowLeft", "ArrowRight", "ArrowLeft").value == 0
        assert wait_until(lambda: desk.extra_presses == 2)
        show(desk, browser, "question", "?", keys=ARROWS, question=CHOICE)
        assert desk.await_response(0) is None  # no press of before counts for the next screen
        browser.press("q")
        assert wait_until(lambda: desk.extra_presses == 3)


@pytest.mark.exhaustive
def test_a_letter_is_the_same_key_with_caps_lock(tmp_path):
    keys = (KeyChoice(key="j", label="yes", value=1), KeyChoice(key="f", label="no", value=0))
    with opened(tmp_path) as (desk, _, browser):
        show(desk, browser, "question", "?", keys=keys, question=CHOICE)
        assert browser.run("[...document.querySelectorAll('kbd')].map((own) => own.textContent)")[-2:] == ["F", "J"]
        assert response_of(desk, browser, "J").key == "j"


@pytest.mark.exhaustive
def test_a_reaction_time_is_that_from_the_painted_screen_to_the_key(tmp_path):
    """The page presses a key itself, a known time after it has painted the screen."""
    delays = (0.2, 0.5, 0.9)
    with opened(tmp_path) as (desk, _, browser):
        for delay in delays:
            number = desk.show("question", "?", keys=ARROWS, question=CHOICE).number
            browser.run(
                "new Promise((done) => { const look = () => {"
                f" if (document.querySelector('#page').dataset.number != '{number}')"
                " return requestAnimationFrame(look);"
                " setTimeout(() => { const event = new KeyboardEvent('keydown', { key: 'ArrowLeft', bubbles: true });"
                f" document.dispatchEvent(event); done() }}, {1000 * delay}) }}; look() }})"
            )
            assert response_of(desk, browser).seconds == pytest.approx(delay, abs=0.03)


@pytest.mark.exhaustive
def test_a_key_that_was_pressed_before_the_screen_was_painted_is_not_for_it(tmp_path):
    with opened(tmp_path) as (desk, _, browser):
        show(desk, browser, "question", "?", keys=ARROWS, question=CHOICE)
        browser.run(
            "(() => { const event = new KeyboardEvent('keydown', { key: 'ArrowLeft', bubbles: true });"
            " Object.defineProperty(event, 'timeStamp', { value: 1 }); document.dispatchEvent(event) })()"
        )
        browser.settle(0.3)
        assert desk.await_response(0) is None


@pytest.mark.exhaustive
def test_a_browser_that_closes_or_is_killed_leaves_no_page_open(tmp_path):
    with served_study() as (desk, server):
        for is_killed in (False, True):
            with Browser(tmp_path) as browser:
                browser.open(server.address())
                assert wait_until(lambda: desk.has_page)
                if not is_killed:
                    browser.call("Page.navigate", url="about:blank")
                else:
                    browser.close = lambda: None
                    Browser.close(browser)
                assert wait_until(lambda: not desk.has_page, 2)


@pytest.mark.exhaustive
def test_a_page_that_is_loaded_again_goes_on_where_it_was(tmp_path):
    with opened(tmp_path) as (desk, _, browser):
        show(desk, browser, "text", "Welcome", keys=SPACE)
        for _ in range(3):
            browser.call("Page.reload")
            browser.settle(0.3)
            browser.wait("document.querySelector('.text')?.textContent === 'Welcome'", timeout=10)
        assert response_of(desk, browser, " ").key == " "


@pytest.mark.exhaustive
def test_a_second_page_is_refused_until_the_first_one_is_closed(tmp_path):
    with opened(tmp_path) as (desk, server, browser):
        show(desk, browser, "text", "Welcome", keys=SPACE)
        with Browser(tmp_path) as second:
            second.open(server.address())
            second.wait("document.querySelector('.alert:not([hidden])')?.textContent.includes('open already')")
            assert response_of(desk, browser, " ").key == " "
            show(desk, browser, "text", "Go on", keys=SPACE)
            browser.call("Page.navigate", url="about:blank")
            second.wait("document.querySelector('.text')?.textContent === 'Go on'", timeout=10)
            assert second.run("document.querySelector('.alert').hidden")
            assert second.errors == []


@pytest.mark.exhaustive
def test_a_lost_connection_is_said_in_large_letters_in_the_plans_words(tmp_path):
    with opened(tmp_path, lost="Verbindung getrennt") as (desk, server, browser):
        show(desk, browser, "text", "Welcome", keys=SPACE)
        server.close()
        browser.wait("document.getElementById('page').innerText === 'Verbindung getrennt'", timeout=10)
        size = "parseFloat(getComputedStyle(document.querySelector('.lost .text')).fontSize)"
        assert browser.run(size) >= 42
        browser.press(" ")
        assert browser.run("document.getElementById('page').innerText") == "Verbindung getrennt"


@pytest.mark.exhaustive
def test_a_hidden_page_goes_on_asking(tmp_path):
    """Its timers are as good as stopped: only the server's answers make it ask again."""
    with opened(tmp_path) as (desk, _, browser):
        show(desk, browser, "text", "Welcome", keys=SPACE)
        browser.run(
            "(() => { Object.defineProperty(document, 'hidden', { get: () => true });"
            " window.setTimeout = () => 0; window.requestAnimationFrame = () => 0;"
            " document.dispatchEvent(new Event('visibilitychange')) })()"
        )
        browser.settle(1.0)
        gaps, last = [], None
        end = time.monotonic() + 3
        while time.monotonic() < end:
            assert desk.has_page
            if desk._seen != last:
                gaps.append(time.monotonic() - (last or time.monotonic()))
                last = desk._seen
            browser.settle(0.02)
        assert 6 <= len(gaps) <= 40
        assert max(gaps) < 0.7
        desk.show("text", "Still there", keys=SPACE)
        browser.wait("document.querySelector('.text').textContent === 'Still there'", timeout=5)


def view_pixels(browser):
    """What is seen of object and hand."""
    browser.settle(1.0)
    left, top, width, height = map(int, browser.box(".view"))
    return browser.pixels()[top : top + height, left : left + width].astype(int)


def hand_count(pixels):
    """How many pixels have the colour of the hand itself."""
    return int((pixels[..., 0] - pixels[..., 2] > 35).sum())


@pytest.mark.exhaustive
def test_an_opaque_object_hides_the_hand_behind_it_and_one_at_an_opacity_does_not(tmp_path):
    scene = scene_around(square_hand())
    moments = [moment_at(scene, BEHIND)]
    with opened(tmp_path, scene=lambda: scene, moment=lambda: moments[0]) as (desk, _, browser):
        beside, changed = {}, {}
        for opacity in (1.0, 0.7):
            show(desk, browser, "stimulus", "1", **show_object(opacity, has_hand=False))
            alone = view_pixels(browser)
            show(desk, browser, "stimulus", "1", **show_object(opacity))
            seen = view_pixels(browser)
            assert hand_count(alone) == 0
            beside[opacity] = hand_count(seen)
            changed[opacity] = int((np.abs(seen - alone).max(axis=2) > 4).sum())
        assert beside[1.0] > 1000
        assert beside[0.7] == pytest.approx(beside[1.0], rel=0.05)
        assert changed[1.0] == pytest.approx(beside[1.0], rel=0.05)  # nothing of it is seen through the object
        assert changed[0.7] > 1.5 * changed[1.0]
        moments[0] = moment_at(scene, POSE - np.float32([0, 0.09, 0, 0, 0, 0, 0]))
        fronts = []
        for opacity in (1.0, 0.7):
            show(desk, browser, "stimulus", "1", **show_object(opacity))
            fronts.append(hand_count(view_pixels(browser)))
        assert fronts[0] > 1.5 * beside[1.0]  # before the object, all of it is seen
        assert fronts[1] == pytest.approx(fronts[0], rel=0.02)


@pytest.mark.exhaustive
def test_the_hand_moves_with_its_pose_and_goes_with_it(tmp_path):
    scene = scene_around(square_hand())
    moments = [moment_at(scene, POSE - np.float32([0.03, 0.09, 0, 0, 0, 0, 0]))]
    with opened(tmp_path, scene=lambda: scene, moment=lambda: moments[0]) as (desk, _, browser):
        show(desk, browser, "stimulus", "1", **show_object())
        before = view_pixels(browser)
        moments[0] = moment_at(scene, POSE - np.float32([-0.03, 0.09, 0, 0, 0, 0, 0]))
        after = view_pixels(browser)
        middles = [np.nonzero(frame[..., 0] - frame[..., 2] > 35)[1].mean() for frame in (before, after)]
        assert middles[1] - middles[0] > 50
        moments[0] = None
        assert hand_count(view_pixels(browser)) == 0


@pytest.mark.exhaustive
def test_the_view_is_there_only_with_an_object_and_words_are_large(tmp_path):
    with opened(tmp_path) as (desk, _, browser):
        for width, height in ((1280, 800), (360, 740)):
            browser.resize(width, height)
            show(desk, browser, "text", "Words", title="Part 1", keys=SPACE)
            assert browser.run("document.querySelector('.view').hidden")
            size = "parseFloat(getComputedStyle(document.querySelector('{}')).fontSize)"
            assert browser.run(size.format(".text")) >= 28
            assert browser.run(size.format(".title")) < browser.run(size.format(".text"))
            show(desk, browser, "stimulus", "1", **show_object())
            assert browser.box(".view canvas")[3] > 0.4 * height
            show(desk, browser, "question", SCALE.text, keys=SCALE_KEYS, question=SCALE)
            assert browser.run("document.documentElement.scrollWidth") <= width
            for each in browser.run(
                "[...document.querySelectorAll('kbd')].map((own) => own.getBoundingClientRect().right)"
            ):
                assert each <= width
        assert browser.run("getComputedStyle(document.querySelector('main')).cursor") == "none"


@pytest.mark.exhaustive
def test_a_long_text_is_read_by_arrow_keys_beside_its_answers(tmp_path):
    keys = (KeyChoice(key="1", label="I agree", value=0), KeyChoice(key="2", label="I do not", value=1))
    with opened(tmp_path) as (desk, _, browser):
        show(desk, browser, "question", "A sentence of the consent.\n" * 60, keys=keys, question=CHOICE)
        assert browser.run("document.querySelector('.keys').getBoundingClientRect().bottom < innerHeight")
        down, up = ".more kbd:last-child", ".more kbd:first-child"
        is_off = "document.querySelector('{}').classList.contains('off')"
        assert (browser.run(is_off.format(up)), browser.run(is_off.format(down))) == (True, False)
        for _ in range(30):
            browser.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowDown", code="ArrowDown")
        browser.wait(is_off.format(down), timeout=5)
        assert not browser.run(is_off.format(up))
        assert desk.extra_presses == 0
        assert response_of(desk, browser, "1").value == 0


@pytest.mark.exhaustive
def test_names_of_a_plan_are_text_and_nothing_else(tmp_path):
    evil = "<img src=x onerror=alert(1)><b>bold</b>"
    with opened(tmp_path) as (desk, server, browser):
        show(
            desk,
            browser,
            "question",
            evil,
            title=evil,
            hint=evil,
            keys=(KeyChoice(key="1", label=evil),),
            question=CHOICE,
        )
        assert browser.run("document.querySelector('.text').textContent") == evil
        assert browser.run("document.querySelectorAll('img, b').length") == 0
        desk.set_status(participant=evil, events=[evil])
        browser.open(server.address(EXPERIMENTER))
        browser.wait(f"document.body.innerText.includes({json.dumps(evil)})")
        assert browser.run("document.querySelectorAll('img, b').length") == 0


@pytest.mark.exhaustive
def test_noise_plays_after_the_first_key_and_only_where_a_screen_has_it(tmp_path):
    """A page that records what WebAudio is given stands for the sound card that a server lacks."""
    with opened(tmp_path, noise_level=0.25) as (desk, _, browser):
        browser.run(
            "(() => { navigator.mediaDevices.enumerateDevices = async () => [{ kind: 'audiooutput' }];"
            " const ramp = AudioParam.prototype.linearRampToValueAtTime; window.ramps = [];"
            " AudioParam.prototype.linearRampToValueAtTime = function (value, time) {"
            "   window.ramps.push(value); window.gain = this; return ramp.call(this, value, time) } })()"
        )
        show(desk, browser, "stimulus", "1", has_noise=True)
        browser.settle(0.3)
        assert "no key" in desk.status()["sound"]
        show(desk, browser, "text", "Welcome", keys=SPACE)
        browser.press(" ")
        show(desk, browser, "stimulus", "1", has_noise=True)
        browser.wait("window.ramps.at(-1) === 1", timeout=20)
        assert wait_until(lambda: desk.status()["sound"] in ("playing", "blocked by the browser"))
        if desk.status()["sound"] == "playing":
            browser.wait("window.gain.value > 0.99", timeout=10)
        show(desk, browser, "text", "Break")
        assert browser.run("window.ramps.at(-1)") == 0


@pytest.mark.exhaustive
def test_the_experimenter_stops_goes_on_and_ends_by_keys_and_buttons(tmp_path):
    with opened(tmp_path, EXPERIMENTER) as (desk, server, browser):
        state = "document.querySelector('.state').textContent"
        browser.wait(f"{state}.startsWith('WAITING')")
        with visit(server) as page:
            page.send('{"ask": "screen", "after": 0}')
            page.recv(timeout=10)
            browser.wait(f"{state} === 'RUNNING'", timeout=10)
            browser.press("s")
            assert wait_until(lambda: desk.is_stopped, 2)
            browser.wait(f"{state} === 'STOPPED'", timeout=10)
            browser.press("g")
            assert wait_until(lambda: not desk.is_stopped, 2)
            browser.click(".stop")
            assert wait_until(lambda: desk.is_stopped, 2)
            browser.wait("!document.querySelector('.go').disabled", timeout=10)
            browser.click(".go")
            assert wait_until(lambda: not desk.is_stopped, 2)
            browser.click("header button:last-of-type")
            browser.wait("document.querySelector('dialog').open", timeout=10)
            browser.press("s")  # stop works here, too
            assert wait_until(lambda: desk.is_stopped, 2)
            browser.click("dialog button:last-of-type")
            assert not desk.is_ended
            browser.click("header button:last-of-type")
            browser.wait("document.querySelector('dialog').open", timeout=10)
            browser.click("dialog .sure")
            assert wait_until(lambda: desk.is_ended, 2)
            browser.wait(f"{state} === 'ENDED'", timeout=10)


@pytest.mark.exhaustive
def test_the_dashboard_has_what_the_run_has_set(tmp_path):
    scene = scene_around(square_hand())
    with opened(tmp_path, EXPERIMENTER, moment=lambda: moment_at(scene)) as (desk, server, browser):
        desk.set_status(
            participant="P03", minutes_left=21.44, own_value=[1, None], faults=["late"], events=["one", "two"]
        )
        desk.show("question", CHOICE.text, title="Part 1", keys=ARROWS, question=CHOICE, progress=0.5)
        browser.wait("document.querySelector('[data-card=More]')", timeout=10)
        cards = browser.run(
            "Object.fromEntries([...document.querySelectorAll('section')].map((s) => [s.dataset.card, s.innerText]))"
        )
        assert re.search(r"Participant\s+P03\s+Minutes left\s+21.4", cards["Run"])
        assert re.search(r"Latency\s+4.0 ms \(99 %: 7.0 ms\)", cards["Array"])
        assert re.search(r"Own value\s+1, \u2013", cards["More"])
        assert CHOICE.text in cards["Participant's page"]
        assert "ArrowLeft: First" in cards["Participant's page"]
        assert "late" in cards["Faults"]
        assert cards["Last events"].index("two") < cards["Last events"].index("one")
        server.close()
        browser.wait("document.querySelector('.state').textContent === 'CONNECTION LOST'", timeout=10)
        assert browser.run("document.querySelector('.stop').disabled")
