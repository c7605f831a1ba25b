"""A report as one HTML page that holds its pictures and style and loads nothing, or as Markdown.

Texts are plain, whoever wrote them: all that HTML, Markdown or a terminal would obey is shown instead. One sign means
something: what stands between two single backticks is a command or a name, set as code. A line of a cell is a line.
"""

import re
import textwrap
from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import Any, Literal, NamedTuple
from urllib.parse import quote

from ..terminal.foreign_text import visible

CONTENTS_FROM = 6
"""Sections from which on an HTML page begins with a list of them."""
WIDTH = 120  # characters of a line of Markdown
LINE_MOST = 1_000_000  # of one that is not wrapped
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"  # a browser's word that nothing is loaded
STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.5rem; border-bottom: 1px solid #8886; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.9rem; width: 100%; }
caption { text-align: left; font-weight: 600; padding-bottom: 0.3rem; }
th, td { text-align: left; vertical-align: top; padding: 0.3rem 0.7rem 0.3rem 0; border-bottom: 1px solid #8884; }
.compare td:nth-child(2), .compare td:nth-child(3) { min-width: 9rem; }
td.number { font-variant-numeric: tabular-nums; white-space: nowrap; }
figure { margin: 1rem 0; background: #fff; color: #222; padding: 0.5rem; border-radius: 4px; }
figure img { max-width: 100%; height: auto; } figcaption { font-size: 0.85rem; }
nav { font-size: 0.9rem; }
footer { margin-top: 3rem; font-size: 0.85rem; }
@media print {
  :root { color-scheme: light; } body { max-width: none; margin: 0; font-size: 11pt; } nav { display: none; }
  .scroll { overflow: visible; } h2 { break-after: avoid; } tr, figure { break-inside: avoid; }
}
"""

_CODE = re.compile(r"(?<!`)`([^`]+)`(?!`)")
_SPACES = re.compile(r"[\t\u00a0\u1680\u2000-\u200a\u202f\u205f\u3000]")  # which `visible` would write as escapes
_NUMBER = re.compile(r"[-+]?[0-9]\S*|[A-Za-z]\S* [=<] [-+]?[0-9]\S*")  # kept on one line, as "p = 0.013" is
_LINE_ENDS = re.compile(r"\r\n|\r|\n")
_PARAGRAPHS = re.compile(r"(?:\r\n|\r|\n)[ \t]*(?:\r\n|\r|\n)\s*")
# What begins markup, HTML, a link or a formula in Markdown, and is no such sign in "p < 0.05", "r_open" and "[Hz]".
_MARKUP = re.compile(
    r"\\(?=[!-/:-@\[-`{-~]|$)|[`*~$|]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])|<(?=[A-Za-z/!?])|&(?=#?[A-Za-z0-9]+;)"
    r"|\](?=[(\[:])|\[(?=\^)"
)
# A word that begins a heading, list, quotation, underline or HTML where it is the first of a line.
_OPENER = r"(?:[-+]+|=+|#+|>\S*|[0-9]{1,9}[.)]|<[A-Za-z/!?]\S*|[|~*_]\S*)(?=\s|$)"
_LINE_OPENER = re.compile(rf"(?m)^(?={_OPENER})([0-9]*)")
_OPENER_IN_CODE = re.compile(rf" (?={_OPENER})")
_JOINED = "\ue000"  # a space at which no line ends; `visible` leaves none of these in a text


class ReportTable(NamedTuple):
    """A table; without a title it has no caption."""

    title: str
    head: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    kind: Literal["compare", "further"] = "further"
    """compare: its second and third column are compared with each other, and are never narrow."""


class ReportPicture(NamedTuple):
    """A picture that an HTML page holds itself."""

    content: bytes | memoryview
    """Of a file, SVG or PNG."""
    alt: str
    """What the picture shows, for who cannot see it."""
    caption: str
    file: str = ""
    """Name that it has beside the page; Markdown shows the picture from there, or leaves it out where this is empty."""

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        kind = "png" if bytes(self.content[:4]) == b"\x89PNG" else "svg+xml"
        return f"data:image/{kind};base64,{b64encode(self.content).decode()}"


@dataclass(frozen=True)
class ReportSection:
    """A heading, and what stands below it: text, pictures, tables."""

    title: str
    text: str
    """Paragraphs, with an empty line between two."""
    tables: tuple[ReportTable, ...] = ()
    pictures: tuple[ReportPicture, ...] = ()


def html_page(title: str, introduction: str, sections: Sequence[ReportSection], footer: str) -> str:
    """The page."""
    has_contents = len(sections) >= CONTENTS_FROM
    anchors = [f"section-{number}" if has_contents else "" for number, _ in enumerate(sections, 1)]
    links = "".join(
        f'<li><a href="#{anchor}">{_html(section.title)}</a></li>\n'
        for anchor, section in zip(anchors, sections, strict=True)
    )
    contents = f'<nav aria-label="Contents"><ul>\n{links}</ul></nav>\n' if has_contents else ""
    body = "".join(_html_section(section, anchor) for section, anchor in zip(sections, anchors, strict=True))
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_html(title, has_code=False)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{_html(title)}</h1>\n{_html_paragraphs(introduction)}{contents}{body}"
        f"<footer>{_html(footer)}</footer>\n</body>\n</html>\n"
    )


def _html_section(section: ReportSection, anchor: str) -> str:
    pictures = "".join(
        f'<figure><img alt="{_html(picture.alt, has_code=False)}" src="{picture.uri}">'
        f"<figcaption>{_html(picture.caption)}</figcaption></figure>\n"
        for picture in section.pictures
    )
    tables = "".join(map(_html_table, section.tables))
    heading = f'<h2 id="{anchor}">' if anchor else "<h2>"
    return f"{heading}{_html(section.title)}</h2>\n{_html_paragraphs(section.text)}{pictures}{tables}"


def _html_paragraphs(text: str) -> str:
    return "".join(f"<p>{_html(paragraph)}</p>\n" for paragraph in _PARAGRAPHS.split(text))


def _html_table(table: ReportTable) -> str:
    caption = f"<caption>{_html(table.title)}</caption>" if table.title else ""
    heads = "".join(f'<th scope="col">{_html(name)}</th>' for name in table.head)
    lines = "".join(f"<tr>{''.join(map(_html_cell, row))}</tr>\n" for row in table.rows)
    return (
        f'<div class="scroll"><table class="{table.kind}">{caption}<thead><tr>{heads}</tr></thead>\n'
        f"<tbody>\n{lines}</tbody></table></div>\n"
    )


def _html_cell(text: str) -> str:
    cell = _html(text, line_end="<br>")
    return f'<td class="number">{cell}</td>' if _NUMBER.fullmatch(text) else f"<td>{cell}</td>"


def _html(text: str, *, line_end: str = " ", has_code: bool = True) -> str:
    """A text as HTML that only shows it; has_code: whether backticks mean something."""
    lines = [_marked(line, escape, lambda code: f"<code>{escape(code)}</code>", has_code) for line in _lines(text)]
    return line_end.join(lines)


def _lines(text: str) -> list[str]:
    """Lines of a text, with escapes for what is not shown as itself, and one kind of space."""
    return [visible(_SPACES.sub(" ", line)) for line in _LINE_ENDS.split(text)]


def _marked(line: str, plain: Callable[[str], str], code: Callable[[str], str], has_code: bool = True) -> str:
    """A line whose code and whose other parts are written in two ways."""
    parts = _CODE.split(line) if has_code else [line]  # every other part was between backticks
    return "".join(code(part) if k % 2 else plain(part) for k, part in enumerate(parts))


def markdown_page(
    title: str, introduction: str, sections: Sequence[ReportSection], footer: str, *, wraps: bool = True
) -> str:
    """The page, as docs/measured/paper.md is made; rows of tables stay on one line, however long.

    wraps: paragraphs have lines of at most WIDTH characters; else one line, to be pasted elsewhere.
    """
    width = WIDTH if wraps else LINE_MOST
    parts = [f"# {_heading(title)}", _wrapped(introduction, width)]
    for section in sections:
        parts += [f"## {_heading(section.title)}", _wrapped(section.text, width)]
        for picture in section.pictures:
            if picture.file:
                alt = re.sub(r"[\\\[\]`*_~$|<&]", r"\\\g<0>", " ".join(_lines(picture.alt)))
                parts += [f"![{alt}]({quote(picture.file)})", _wrapped(picture.caption, width)]
        for table in section.tables:
            parts += [_wrapped(f"{table.title}:", width)] * bool(table.title)
            lines = [_markdown_line(table.head), "|" + "---|" * len(table.head), *map(_markdown_line, table.rows)]
            parts.append("\n".join(lines))
    return "\n\n".join([*parts, _wrapped(footer, width)]) + "\n"


def _heading(text: str) -> str:
    shown = _markdown(text).replace(_JOINED, " ")
    return re.sub(r"#+\s*$", lambda signs: f"\\{signs[0]}", shown)  # else these close a heading, unseen


def _wrapped(text: str, width: int) -> str:
    """Paragraphs in lines of at most `width` characters, none of which begins with what opens a list or a heading."""
    filled = [
        textwrap.fill(_markdown(paragraph).strip(), width, break_long_words=False, break_on_hyphens=False)
        for paragraph in _PARAGRAPHS.split(text)
    ]
    return "\n\n".join(_LINE_OPENER.sub(r"\1\\", paragraph).replace(_JOINED, " ") for paragraph in filled)


def _markdown_line(cells: Sequence[str]) -> str:
    texts = [_markdown(cell, line_end="<br>", in_table=True).replace(_JOINED, " ") for cell in cells]
    return f"| {' | '.join(texts)} |"


def _markdown(text: str, *, line_end: str = " ", in_table: bool = False) -> str:
    """A text as Markdown that only shows it; the spaces at which no line may end are _JOINED."""

    def plain(part: str) -> str:
        return _MARKUP.sub(lambda sign: f"\\{sign[0]}", part)

    def code(part: str) -> str:
        kept = _OPENER_IN_CODE.sub(_JOINED, part)
        return f"`{kept.replace('|', chr(92) + '|') if in_table else kept}`"  # only tables divide code at bars

    return line_end.join(_marked(line, plain, code) for line in _lines(text))


PICTURE_STYLE = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "palpate",  # else ids differ from run to run
}


@contextmanager
def drawing(width: float, height: float) -> Iterator[Any]:
    """A figure of this size [inch] in the report's style."""
    import matplotlib as mpl  # 0.7 s that only pictures cost
    from matplotlib.figure import Figure

    with mpl.rc_context(PICTURE_STYLE):
        yield Figure(figsize=(width, height), layout="constrained")
