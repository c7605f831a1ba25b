"""A command that is told to write where it reads refuses, and the rendering is as it was."""

import re

import pytest
from command_line import MISUSED, refused

from palpate.render import exploration, render

WAYS = {
    "view --export": ["view", "FILE.html", "--export", "FILE.html"],
    "figure": ["figure", "FILE.png", "-o", "FILE.png"],
    "figure of two": ["figure", "OTHER", "FILE.svg", "-o", "FILE.svg"],
    "field": ["field", "FILE.png", "-o", "FILE.png"],
    "noise": ["noise", "FILE.png", "-o", "FILE.png"],
    "noise --wav": ["noise", "FILE.wav", "--wav"],
    "export": ["export", "FILE.csv", "-o", "FILE.csv"],
}


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    path = tmp_path_factory.mktemp("kept") / "a.h5"
    render("tube", "palm", exploration("tube", duration=0.3, seed=1), "oc").save(path)
    return path.read_bytes()


@pytest.mark.parametrize("way", WAYS)
def test_a_source_is_not_replaced(content, tmp_path, way):
    names = {"FILE": str(tmp_path / "file"), "OTHER": str(tmp_path / "b.h5")}
    words = [re.sub("FILE|OTHER", lambda found: names[found[0]], word) for word in WAYS[way]]
    source = next(tmp_path / word for word in words if "/file." in word)
    source.write_bytes(content)
    (tmp_path / "b.h5").write_bytes(content)
    refused(MISUSED, "is the file to read", *words, "--overwrite")
    assert source.read_bytes() == content
    assert {path.name for path in tmp_path.iterdir()} == {source.name, "b.h5"}
