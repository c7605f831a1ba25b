"""A sweep's summary in Markdown, as a reader of Markdown shows it: what it holds, and that names cannot break it."""

from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from sweep_rows import table

from palpate.datasets.sweeps.store import Failure
from palpate.render.errors import SweepError
from palpate.render.sweeps.report.compare import Baseline, compare_tables
from palpate.render.sweeps.report.summary import TEXT_MOST, append_summary, sweep_summary
from palpate.render.sweeps.run.sweep_run import SweepReport
from palpate.render.terminal.foreign_text import visible

HOSTILE = ["<img src=x onerror=alert(1)>", "a | b", "`a", "**a**", "[a](http://b)", "![a](b)", "\\|", "&lt;", "- a",
           "1. a", "# a", "---", "a\n\n# b", "~~a~~", "__a__", "<!--", "www.a.com", "@a", "a\\", "|"]  # fmt: skip
NAMES = st.one_of(st.sampled_from(HOSTILE), st.text("|<>`*_[]()#\\&!~-+.:@$ \n\ta1", min_size=1), st.text(min_size=1))


READER = MarkdownIt("commonmark").enable(["table", "strikethrough"])


class Page(HTMLParser):
    """Texts of the cells, headings and paragraphs of a page, and its tags."""

    def __init__(self, markdown):
        super().__init__()
        self.tags, self.texts = set(), []
        self.feed(READER.render(markdown))

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        if tag in ("td", "th", "p", "h3", "h4"):
            self.texts.append((tag, ""))
        assert all(name == "style" for name, _ in attrs)  # of a cell

    def handle_data(self, data):
        if data.strip() or self.texts[-1][1]:
            self.texts[-1] = (self.texts[-1][0], self.texts[-1][1] + data)

    def of(self, *tags):
        return [text.strip() for tag, text in self.texts if tag in tags]


TAGS = {"table", "thead", "tbody", "tr", "th", "td", "p", "h3", "h4"}
SEEDS = [{"seed": k} for k in range(30)]


def compared(old, new):
    columns = {name: np.array(values) for name, values in table(*old).items()}
    return compare_tables(Baseline("old.csv", columns), table(*new))


@settings(max_examples=40)
@given(NAMES)
@example("<script>alert(1)</script>")
def test_a_name_is_shown_as_it_is_and_begins_nothing(name):
    failure = Failure("00", name, f"{name}: {name}")
    page = Page(sweep_summary(name, SweepReport(1, 0, 10, 10, 0, 1.5, failures=(failure,)), None))
    assert page.tags <= TAGS
    cut = " ".join(visible(name).split())
    if len(cut) < TEXT_MOST:
        cells = [" ".join(text.split()) for text in page.of("td")]
        assert cells[-2:] == [cut, cut]
        assert [" ".join(text.split()) for text in page.of("h3")] == [f"Sweep {cut}".strip()]
    assert len(page.of("td")) == 6 + 2


def test_what_moved_and_what_is_new_or_missing_stands_in_tables():
    old = [{"seed": k, "recipe_hash": f"h{k}"} for k in range(4)]
    new = [{"seed": k, "recipe_hash": f"h{k}", "length_mean": 0.2 if k != 2 else 0.3} for k in range(1, 6)]
    page = Page(sweep_summary("study", SweepReport(5, 0, 500, 500, 0, 75.0, executor="in process"), compared(old, new)))
    assert page.of("td")[:6] == ["5", "0", "500", "500", "1 min 15 s", "in process"]
    assert page.of("td")[6:] == ["seed=2", "length_mean", "0.2", "0.3", "+50 %", "seed=0", "seed=4", "seed=5"]
    assert page.of("h4") == ["What moved", "Recipes of the baseline that are missing", "New recipes"]
    assert any(text.startswith("1 of 18 values moved in 3 recipes compared with old.csv") for text in page.of("p"))


def test_tables_are_short_and_count_what_they_lack():
    moved = [row | {"length_mean": 0.3} for row in SEEDS]
    page = Page(sweep_summary("x", SweepReport(30, 0, 30, 0, 30, 0.1), compared(SEEDS, moved), row_count=4))
    assert page.of("td").count("length_mean") == 4
    assert "and 26 more" in page.of("p")


def test_a_summary_is_appended(tmp_path):
    path = tmp_path / "step"
    for name in ("first", "second"):
        append_summary(path, sweep_summary(name, SweepReport(1, 0, 10, 10, 0, 1.0), None))
    assert Page(path.read_text()).of("h3") == ["Sweep first", "Sweep second"]
    path.write_text("no line feed")
    append_summary(path, "### after\n")
    assert Page(path.read_text()).of("h3") == ["after"]
    with pytest.raises(SweepError, match="cannot be written"):
        append_summary(tmp_path / "missing" / "step", "")
