"""The HTML of a page: foreign text is shown and not obeyed, nothing is fetched, and exactly its own script runs."""

import base64
import hashlib
import json
import re
from importlib.resources import files

import pytest
from page_oracle import elements_of, text_of

from palpate.render import ViewError
from palpate.render.view.page import document as module
from palpate.render.view.page.document import document

NAMES = [
    "</script><script>alert(1)</script>",
    "<!--<script>",
    "</SCRIPT\t>",
    "]]>&lt;b&gt;&amp;",
    '"></title><img src=x onerror=alert(1)>',
    "\u202egpj.exe\u202c",
    "line\u2028break\nand\x00zero\x1b[31m",
    "caf\u00e9 \u624b",
    b"\xff\xfe".decode("utf-8", "surrogateescape"),
]
TAGS = [
    "html", "head", "meta", "meta", "meta", "meta", "link", "title", "style", "body", "div", "noscript",
    "script", "script", "script", "script",
]  # fmt: skip


def test_whatever_a_name_holds_the_page_has_the_same_elements():
    for name in NAMES:
        page = document({"title": name, "files": [{"name": name}]}, "AAAA", name)
        assert [tag for tag, _, _ in elements_of(page)] == TAGS, name
        described = text_of(page, "described")
        assert json.loads(described)["files"][0]["name"] == name  # JSON takes it all; the page shows text
        assert described.isascii()
        assert not set(described) & set("<>&"), name  # nothing could end its element
        page.encode()  # no lone surrogate is left
        head = next(text for tag, _, text in elements_of(page) if tag == "title")
        assert head.isprintable(), name
        assert "<" not in page.split("<title>")[1].split("</title>")[0], name


def test_only_the_pages_own_script_and_style_are_allowed():
    page = document({}, "", "x")
    elements = elements_of(page)
    policy = next(a["content"] for _, a, _ in elements if a.get("http-equiv") == "Content-Security-Policy")
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    script = next(text for tag, attributes, text in elements if tag == "script" and not attributes)
    style = next(text for tag, _, text in elements if tag == "style")
    for name, text in (("script-src", script), ("style-src", style)):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert rules[name] == f"'sha256-{digest}'"
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert rules["img-src"] == "data:"


def test_nothing_is_linked_but_an_empty_icon():
    for tag, attributes, _ in elements_of(document({}, "", "x")):
        assert "src" not in attributes, tag
        assert attributes.get("href") in (None, "data:,")
    style = files("palpate.render.view.page").joinpath("assets", "page.css").read_text()
    assert not re.search(r"url\(|@import", style)


def test_the_licences_of_what_is_in_the_script_are_in_the_page():
    text = text_of(document({}, "", "x"), "licences")
    assert "three 0." in text
    assert "uplot 1." in text
    assert text.count("Permission is hereby granted, free of charge") == 2
    assert text.count("Copyright") >= 2


@pytest.mark.parametrize("content", ["x </script> y", "x <!-- y", "x </STYLE> y"])
def test_a_script_that_would_end_too_soon_is_refused(content, monkeypatch, tmp_path):
    (tmp_path / "assets").mkdir()
    for name in module.ASSETS:
        (tmp_path / "assets" / name).write_text(content)
    monkeypatch.setattr(module, "files", lambda _: tmp_path)
    with pytest.raises(ViewError, match=r"page\.js would end where it must not"):
        document({}, "", "x")


def test_a_missing_script_is_a_sentence(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "files", lambda _: tmp_path)
    with pytest.raises(ViewError, match=r"page\.js is missing from this installation"):
        document({}, "", "x")
