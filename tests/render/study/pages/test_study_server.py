"""A study's two pages in a real browser: a scripted study by keys alone, what is seen of object and hand, and stop."""

import re
import time
from contextlib import contextmanager

import pytest
from browser import Browser
from page_oracle import elements_of
from study_cases import (
    AGE,
    ARROWS,
    CHOICE,
    SCALE,
    SCALE_KEYS,
    SPACE,
    WORDS,
    served_study,
    visit,
    wait_until,
)

from palpate.render.errors import StrategyError
from palpate.render.study.pages.experimenter_page import EXPERIMENTER, PARTICIPANT
from palpate.render.study.run.desk import KeyChoice


def page_of(server, path):
    """The HTML of a page."""
    import urllib.request

    with urllib.request.urlopen(server.address(path)) as answer:
        return answer.read().decode()


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
def test_a_letter_is_the_same_key_with_caps_lock(tmp_path):
    keys = (KeyChoice(key="j", label="yes", value=1), KeyChoice(key="f", label="no", value=0))
    with opened(tmp_path) as (desk, _, browser):
        show(desk, browser, "question", "?", keys=keys, question=CHOICE)
        assert browser.run("[...document.querySelectorAll('kbd')].map((own) => own.textContent)")[-2:] == ["F", "J"]
        assert response_of(desk, browser, "J").key == "j"


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
