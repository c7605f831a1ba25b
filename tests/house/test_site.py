"""The docs site builds without a warning, asks nobody for anything, and has what its navigation names."""

import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
import yaml
from page_blocks import ROOT, blocks_of

from palpate.render import MeshObject

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
RESOURCES = {"link": "href", "script": "src", "img": "src", "source": "src", "iframe": "src", "object": "data"}
OUTSIDE = re.compile(r"^(?:[a-z]+:)?//")


class Page(HTMLParser):
    """What a browser fetches for a page, without a click, and the text of its headings."""

    def __init__(self, path):
        super().__init__()
        self.fetched, self.styles, self.ids = [], [], set()
        self.feed(path.read_text())

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids.add(given.get("id"))
        self.styles.append(given.get("style") or "")
        if given.get(RESOURCES.get(tag)):
            self.fetched.append(given[RESOURCES[tag]])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site as built, its notebooks run."""
    pytest.importorskip("mkdocstrings", reason="the extra docs is not installed")
    pytest.importorskip("nbclient", reason="the extra docs is not installed")
    folder = tmp_path_factory.mktemp("site")
    nowhere = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), "http://127.0.0.1:9")
    quiet = os.environ | nowhere | {"NO_MKDOCS_2_WARNING": "1"}  # a request of the build would fail
    # No --quiet: it keeps warnings from --strict, which then passes.
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(words, cwd=ROOT, env=quiet, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.exhaustive
def test_a_reader_s_browser_fetches_nothing_from_elsewhere(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 40
    for path in pages:
        page = Page(path)
        assert [name for name in page.fetched if OUTSIDE.match(name)] == [], path
        assert not [style for style in page.styles if "url(" in style], path
    for path in site.rglob("*.css"):
        fetched = re.findall(r"(?:url\(|@import)\s*[\"']?([^\"')\s]*)", path.read_text())
        assert [name for name in fetched if OUTSIDE.match(name)] == [], path


@pytest.mark.exhaustive
def test_the_first_page_shows_a_rendering_that_is_a_page_of_its_own(site):
    (source,) = [name for name in Page(site / "index.html").fetched if name.endswith("dog.html")]
    shown = (site / source).read_text()
    assert "palpate" in shown
    assert 100_000 < len(shown) < 2_000_000
    assert [name for name in Page(site / source).fetched if not name.startswith("data:")] == []  # it holds everything


@pytest.mark.exhaustive
def test_names_options_and_notebooks_are_pages(site):
    from palpate import device, render

    assert {"render", "MeshObject", "Palm"} <= set(render.__all__)
    for package in (render, device):
        page = Page(site / "reference" / package.__name__.rpartition(".")[2] / "index.html")
        ends = {str(name).rpartition(".")[2] for name in page.ids}
        classes = [
            name
            for name in package.__all__
            if callable(value := getattr(package, name))
            and not (isinstance(value, type) and issubclass(value, BaseException))
        ]
        assert set(classes) - ends == set()
    assert "options-of-all-commands" in Page(site / "guide" / "options" / "index.html").ids
    for book in NOTEBOOKS:
        pictures = list((site / "notebooks").glob(f"{book.stem}-*.png"))
        assert pictures
        assert all(path.stat().st_size > 5_000 for path in pictures)
        assert (site / "notebooks" / book.stem / "index.html").exists()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_is_committed_without_what_it_showed(path):
    for cell in json.loads(path.read_text())["cells"]:
        assert cell.get("outputs", []) == []
        assert cell.get("execution_count") is None


@pytest.mark.exhaustive
def test_concept_figures_are_what_palpate_draws():
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        import concept_figures
    finally:
        sys.path.remove(str(ROOT / "docs"))
    assert MeshObject.load("tube").bounds[1, 0] == pytest.approx(0.065)  # what the figures are of
    for name, made in concept_figures.figures().items():
        assert made == (ROOT / "docs" / name).read_text(), "run: python docs/concept_figures.py"


def test_links_of_pages_at_the_root_lead_somewhere():
    """MkDocs checks those in docs/; a notebook is a page in either place."""
    for name in ("README.md", "CONTRIBUTING.md"):
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", (ROOT / name).read_text()):
            assert OUTSIDE.match(target) or target.startswith("http") or (ROOT / target).exists(), f"{name}: {target}"


def test_the_citation_has_what_its_format_requires():
    """Keys and types of the Citation File Format 1.2.0, as its schema requires them."""
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= set(cited)
    project = (ROOT / "pyproject.toml").read_text()
    assert f'version = "{cited["version"]}"' in project
    assert f'license = "{cited["license"]}"' in project
    for work in cited["references"]:
        assert {"type", "title", "authors"} <= set(work)
        assert re.fullmatch(r"10\.\d{4,}/\S+", work["doi"])
        assert work["doi"] in (ROOT / "docs/measured/paper.md").read_text().replace("\n", " ")


def test_blocks_with_a_title_are_files_that_a_reader_can_write():
    named = [block.name for path in (ROOT / "docs").rglob("*.md") for block in blocks_of(path) if block.name]
    assert named
    assert all(not Path(name).is_absolute() and ".." not in Path(name).parts for name in named)
