"""Foreign text on the page is text: no tag, no script, no character that turns the rest around."""

from html.parser import HTMLParser

import pytest

from palpate.render import exploration, render
from palpate.render.view.file_scene import FileScene
from palpate.render.view.live.numbers import facts_html, failure_html, moment_html, safe

EVIL = "<img src=x onerror=alert(1)>\u202egnp.\x1b[31m{1+1}"


class Tags(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.tags, self.words = [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.words += data


@pytest.fixture
def scene(tmp_path):
    path = render("tube", "palm", exploration("tube", duration=1.0, seed=1), "cc").save(tmp_path / "a.h5")
    with FileScene(path) as opened:
        yield opened


def test_foreign_text_makes_no_tags(scene):
    scene.object_name = EVIL
    for html in (safe(EVIL), failure_html(EVIL), facts_html([scene], [EVIL], [EVIL])):
        page = Tags(html)
        assert {tag for tag, _ in page.tags} <= {"div", "b", "br"}
        assert not any("onerror" in attributes for _, attributes in page.tags)
        assert "<img src=x onerror=alert(1)>" in page.words
        assert "\u202e" not in page.words
        assert "\x1b" not in page.words


def test_the_numbers_of_a_pose(scene):
    page = Tags(moment_html([scene.moment(54), scene.moment(0)], [scene, scene], ["a", "b"]))
    length = 1e3 * scene.file.metrics(54, 55)["length"][0]
    assert f"{length:.1f} mm" in page.words
    assert f"{7e3 / length:.1f} Hz" in page.words
    assert "54 of 0..89" in page.words
    assert "0.600 s" in page.words
