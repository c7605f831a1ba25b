"""Report pages: texts from outside are shown and not obeyed, pictures are inside, nothing is loaded."""

import re
from html.parser import HTMLParser

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from palpate.render.reports.picture_style import DPI, picture_bytes
from palpate.render.reports.report_pages import (
    CONTENTS_FROM,
    WIDTH,
    ReportPicture,
    ReportSection,
    ReportTable,
    drawing,
    html_page,
    markdown_page,
)
from palpate.render.terminal.foreign_text import visible

TABLE = ReportTable("Further <numbers>", ("name", "number"), (("cube", "1.5"),))
COMPARED = ReportTable("", ("result", "paper", "palpate"), (("r | cube", "2.54", "3 < 4"),), "compare")
PNG, SVG = b"\x89PNG\r\n\x1a\n", b"<svg/>"
PICTURE = ReportPicture(PNG, 'a "plot"', "Below.")
SECTION = ReportSection("Figure 6C", "Text with <b>.", (COMPARED, TABLE), (PICTURE,))
HOSTILE = [
    "<script>alert(1)</script>", "<img src=x onerror=alert(1)>", "</td></tr></table>", "<!--", "&lt;b&gt;", "&#96;",
    "a | b", "|---|---|", "`a", "``", "a\\`", "`a`b`", "a`<b>`c", "` `", "**a**", "[a](http://b)", "![a](b)", "[a]: b",
    "\\|", "\\", "- a", "+ a", "1. a", "12) a", "# a", "a #", "---", "===", "a\n===", "a\n\n# b", "a\n- b", "> a",
    "~~a~~", "~~~", "__a__", "_a_", "$a$", "\x1b[31m", "\u202eabc", "a\u200bb", "\u2028", "\0", "\x07", "a\r\nb",
    "a\tb", "    a", "=1+1", "", " ", "\n", "\n\n", "'\"", "x - y " * 40, "x # y = z " * 40, "x 1. y --- ~~~ " * 40,
    "a `<div> # b - c 1. d` " * 12,
]  # fmt: skip
TEXTS = st.one_of(st.sampled_from(HOSTILE), st.text("|<>`*_[]()#\\&;!~-+=.:$ \n\ta1", min_size=1), st.text())
READER = MarkdownIt("commonmark").enable(["table", "strikethrough"])
VOID = ("meta", "img", "br")


class ReadPage(HTMLParser):
    """A page as a browser takes it: elements, closed in order, and their texts, a line break as a newline."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.open, self.texts, self.attributes = [], [], [], []
        self.feed(page)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value) for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)
            self.texts.append((tag, ""))
        elif tag == "br":
            self.handle_data("\n")

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        place = next((k for k in range(len(self.texts) - 1, -1, -1) if self.texts[k][0] not in ("code",)), None)
        if place is not None:
            self.texts[place] = (self.texts[place][0], self.texts[place][1] + data)

    def of(self, tag):
        return [" ".join(text.split()) for own, text in self.texts if own == tag]


def plain_words(text):
    """What a reader sees of a text: its words, without the two backticks around code."""
    return " ".join(visible_lines(text).replace("`", "").split())


def visible_lines(text):
    """Lines of a text with escapes for what does not print, joined by spaces; a tab and a no-break space are spaces."""
    spaces = "\t\xa0\u1680\u202f\u205f\u3000" + "".join(map(chr, range(0x2000, 0x200B)))
    text = text.translate(dict.fromkeys(map(ord, spaces), " "))
    return " ".join(visible(line) for line in text.replace("\r\n", "\n").replace("\r", "\n").split("\n"))


def hostile_page(text):
    table = ReportTable(text or "t", (text, "b"), ((text, "x"), ("y", text)))
    return ("Title", text, [ReportSection(text, text, (table,), (ReportPicture(SVG, text, text, "a.svg"),))], text)


def test_texts_are_escaped_in_html():
    page = html_page("Title <x>", "Introduction & more", [SECTION], "footer")
    assert "<title>Title &lt;x&gt;</title>" in page
    assert "Text with &lt;b&gt;." in page
    assert "<td>3 &lt; 4</td>" in page
    assert '<img alt="a &quot;plot&quot;" src="data:image/png;base64,' in page
    assert '<table class="compare"><thead>' in page
    assert page.count("<table") == page.count("</table>") == 2


def require_shown_in_html(text):
    """The text stands in the page as it is, and adds no element."""
    page, calm = ReadPage(html_page(*hostile_page(text))), ReadPage(html_page(*hostile_page("a")))
    unmarked = [tag for tag in page.tags if tag not in ("br", "code", "p")]
    assert unmarked == [tag for tag in calm.tags if tag not in ("br", "code", "p")]
    assert {name for _, name, _ in page.attributes} == {name for _, name, _ in calm.attributes}
    assert [plain_words(cell) for cell in page.of("td")[::3]] == [plain_words(text)] * 2
    assert plain_words(page.of("h2")[0]) == plain_words(text)
    shown = "".join(own for tag, own in page.texts if tag != "style").replace("\n", "")
    assert shown.isprintable()


def require_shown_in_markdown(text):
    """The text stands in the page that Markdown becomes, and begins nothing there."""
    page = ReadPage(READER.render(markdown_page(*hostile_page(text))))
    assert set(page.tags) <= {"h1", "h2", "p", "img", "table", "thead", "tbody", "tr", "th", "td", "code", "br"}
    assert len(page.of("td")) == 4
    assert [plain_words(cell) for cell in page.of("td")[::3]] == [plain_words(text)] * 2
    assert [plain_words(heading) for heading in page.of("h2")] == [plain_words(text)]
    assert [value for tag, name, value in page.attributes if (tag, name) == ("img", "src")] == ["a.svg"]


@pytest.mark.exhaustive
@settings(max_examples=1500, deadline=None)
@given(TEXTS)
def test_no_text_from_outside_is_obeyed(text):
    require_shown_in_html(text)
    require_shown_in_markdown(text)


@pytest.mark.parametrize("text", HOSTILE)
def test_a_text_that_is_known_to_break_pages_is_shown(text):
    require_shown_in_html(text)
    require_shown_in_markdown(text)


def test_usual_texts_stay_readable_in_markdown():
    text = "p < 0.001, r_open = 2.44 ± 0.03 [Hz]; +5 %, -0.10 dB (figure 6C) & more: see docs/measured/noise.md."
    assert text in markdown_page("T", "I", [ReportSection("S", text)], "F by `palpate reproduce`.")


def test_code_stands_between_backticks_in_both():
    section = ReportSection("S", "Call `palpate study a|b.toml`.", (ReportTable("", ("a",), (("`a|b`",),)),))
    page, markdown = html_page("T", "I", [section], "F"), markdown_page("T", "I", [section], "F")
    assert "<p>Call <code>palpate study a|b.toml</code>.</p>" in page
    assert "<td><code>a|b</code></td>" in page
    assert "Call `palpate study a|b.toml`." in markdown
    assert "| `a\\|b` |" in markdown


def test_paragraphs_and_lines_of_cells_stay_apart():
    section = ReportSection("S", "First.\n\nSecond\nline.", (ReportTable("", ("a",), (("one\ntwo",),)),))
    page, markdown = html_page("T", "I", [section], "F"), markdown_page("T", "I", [section], "F")
    assert "<p>First.</p>\n<p>Second line.</p>" in page
    assert "one<br>two" in page
    assert "\n\nFirst.\n\nSecond line.\n\n" in markdown
    assert "| one<br>two |" in markdown


@pytest.mark.parametrize(
    ("cell", "is_number"),
    [("1.5", True), ("-0.5", True), ("p = 0.013", True), ("t(17) < 2", True), ("3 cells", False), ("p = none", False)],
)
def test_a_number_stays_on_one_line(cell, is_number):
    page = html_page("T", "I", [ReportSection("S", "", (ReportTable("", ("a",), ((cell,),)),))], "F")
    assert ('<td class="number">' in page) == is_number


def test_lines_of_markdown_are_short_except_in_tables():
    markdown = markdown_page("T", "word " * 90, [ReportSection("S", "word " * 90, (TABLE,))], "F")
    assert max(map(len, markdown.splitlines())) <= WIDTH


def test_markdown_links_pictures_that_have_a_file_and_leaves_out_others():
    linked = ReportPicture(SVG, "The means: [0.7] and 0.5", "Caption.", "p cc(1).svg")
    markdown = markdown_page("T", "I", [ReportSection("S", "Text.", (), (linked, PICTURE))], "F")
    assert "![The means: \\[0.7\\] and 0.5](p%20cc%281%29.svg)\n\nCaption.\n\n" in markdown
    assert "Below." not in markdown


def test_a_list_of_contents_begins_a_page_of_many_sections():
    few = [ReportSection(f"Part {k}", "Text.") for k in range(CONTENTS_FROM - 1)]
    assert "<nav" not in html_page("T", "I", few, "F")
    page = ReadPage(html_page("T", "I", [*few, ReportSection("Last <part>", "Text.")], "F"))
    targets = [value for tag, name, value in page.attributes if name == "href"]
    anchors = [value for tag, name, value in page.attributes if (tag, name) == ("h2", "id")]
    assert targets == [f"#{anchor}" for anchor in anchors]
    assert len(set(anchors)) == CONTENTS_FROM
    assert page.of("a")[-1] == page.of("h2")[-1] == "Last <part>"
    assert page.of("a")[:1] == ["Part 0"]


def test_pictures_are_the_same_every_time_and_name_no_page_to_load():
    contents = []
    for _ in range(2):
        with drawing(2.0, 1.0) as figure:
            figure.subplots().plot([0, 1], [1, 0])
            contents.append(bytes(picture_bytes(figure, "svg", dpi=DPI)))
    assert contents[0] == contents[1]
    svg = contents[0].decode()
    assert not re.search(r"(?:href|src)\s*=\s*[\"'](?!#)", svg)
    assert "<date" not in svg.lower().replace("dc:", "<")


def test_the_address_of_a_picture_says_of_what_kind_it_is():
    with drawing(0.5, 0.5) as figure:
        kinds = [
            ReportPicture(picture_bytes(figure, kind, dpi=DPI), "", "").uri.split(";")[0] for kind in ("svg", "png")
        ]
    assert kinds == ["data:image/svg+xml", "data:image/png"]
