"""`palpate reproduce` from the command line to its three files, and what it refuses."""

import json
import re
from html.parser import HTMLParser

import pytest
from command_line import FAILED, MISUSED, answer, refused, run

from palpate.render.reproduction import command

SMALL = ("--explorers", "2", "--repetitions", "1", "--recording", "2")
VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """What a page names in attributes, and whether its elements are closed in order."""

    def __init__(self):
        super().__init__()
        self.loaded, self.open, self.headings = [], [], []

    def handle_starttag(self, tag, attrs):
        self.loaded += [value for name, value in attrs if name in ("src", "href", "data", "srcset", "action")]
        assert tag not in ("script", "link", "iframe", "object", "base")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] == ["h2"]:
            self.headings.append(data)


@pytest.fixture
def brief(monkeypatch):
    """Times of stages measured once, on few poses: a quick run."""
    for name, value in {"MESHES": ("tube",), "LIVE_POSES": 3, "BATCH_POSES": 20, "REPEATS": 1}.items():
        monkeypatch.setattr(command, name, value)


@pytest.mark.exhaustive
def test_the_command_makes_a_page_that_loads_nothing_and_the_numbers_beside(tmp_path, brief):
    out = tmp_path / "new" / "report"
    printed = answer("reproduce", "-o", out, *SMALL)
    assert sorted(path.name for path in out.iterdir()) == ["paper.html", "paper.json", "paper.md"]
    assert printed["html"] == str(out / "paper.html")
    text = (out / "paper.html").read_text()
    page = Page()
    page.feed(text)
    assert page.open == []
    assert page.loaded
    assert all(value.startswith(("data:image/", "#section-")) for value in page.loaded)
    assert not re.search(r"@import|url\(", text)
    assert [heading.split(":")[0] for heading in page.headings] == [
        "Section 4.3.1", "Section 4.3.2 and figure 4", "Sections 4.2 and 4.3", "Figure 5B", "Figure 6C",
        "Sections 5.2 and 6.2",
    ]  # fmt: skip
    values = json.loads((out / "paper.json").read_text())
    assert {key: value for key, value in printed.items() if key in values} == values
    for reading in ("r", "r_open"):
        assert set(values[reading]) == {"cube", "tube", "dog"}
        assert all(found["mean"] >= 1.0 and found["sd"] >= 0.0 for found in values[reading].values())
        assert all(found["blocks"] == 4 for found in values[reading].values())
    assert values["r"]["cube"]["mean"] >= values["r_open"]["cube"]["mean"]
    assert (values["explorers"], values["repetitions"], values["palm"]) == (2, 1, [0.085, 0.085])
    assert {"db_300_10k", "db_40_300", "dba", "rms"} <= set(values["noise"])
    assert values["noise"]["db_300_10k"] > 0  # jumps are louder than none
    markdown = " ".join((out / "paper.md").read_text().split())
    assert f"r = {values['r']['tube']['mean']:.2f}" in markdown
    assert "--explorers 2 --repetitions 1 --palm 0.085 0.085" in markdown

    refused(MISUSED, "paper.html: exists; --overwrite replaces it", "reproduce", "-o", out, *SMALL)
    table = run("reproduce", "-o", out, *SMALL, "--overwrite", "--palm", "0.07", "0.1", "--recording", "0")
    assert table.exit_code == 0
    assert "r, cube" in table.stdout
    assert re.search(r"p_CC above 0.5 \(Wilcoxon\) +p < 0.001 +needs people", table.stdout)
    values = json.loads((out / "paper.json").read_text())
    assert values["palm"] == [0.07, 0.1]
    assert "noise" not in values  # nothing is said of what is not predicted


def test_a_folder_that_cannot_be_made_or_written_is_refused(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    refused(FAILED, "file: cannot be made (File exists)", "reproduce", "-o", tmp_path / "file")
    refused(MISUSED, "report: cannot be made (Not a directory)", "reproduce", "-o", tmp_path / "file" / "report")
    monkeypatch.setattr(command, "access", lambda path, mode: False)
    refused(FAILED, "no file can be written there (permission denied)", "reproduce", "-o", tmp_path)
