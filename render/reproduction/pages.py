"""A report as one HTML page that holds its pictures and style and loads nothing, or as Markdown without pictures."""

import textwrap
from collections.abc import Sequence
from html import escape

from .sections import ReportSection

ROW_HEAD = ("result", "paper", "palpate", "why they differ")
WIDTH = 120  # characters of a line of Markdown
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
footer { margin-top: 3rem; font-size: 0.85rem; }
"""


def html_page(title: str, introduction: str, sections: Sequence[ReportSection], footer: str) -> str:
    """The page; all texts are plain, and escaped here."""
    body = "".join(_html_section(section) for section in sections)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n<p>{escape(introduction)}</p>\n{body}"
        f"<footer>{escape(footer)}</footer>\n</body>\n</html>\n"
    )


def _html_section(section: ReportSection) -> str:
    pictures = "".join(
        f'<figure><img alt="{escape(picture.alt)}" src="{picture.uri}">'
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>\n"
        for picture in section.pictures
    )
    compared = _html_table("", ROW_HEAD, section.rows, "compare") if section.rows else ""
    further = "".join(_html_table(table.title, table.head, table.rows, "further") for table in section.tables)
    return f"<h2>{escape(section.title)}</h2>\n<p>{escape(section.text)}</p>\n{pictures}{compared}{further}"


def _html_table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], kind: str) -> str:
    caption = f"<caption>{escape(title)}</caption>" if title else ""
    heads = "".join(f'<th scope="col">{escape(name)}</th>' for name in head)
    lines = "".join(f"<tr>{''.join(_html_cell(cell) for cell in row)}</tr>\n" for row in rows)
    return (
        f'<div class="scroll"><table class="{kind}">{caption}<thead><tr>{heads}</tr></thead>\n'
        f"<tbody>\n{lines}</tbody></table></div>\n"
    )


def _html_cell(text: str) -> str:
    is_number = text[:1].isdigit() and " " not in text
    return f'<td class="number">{escape(text)}</td>' if is_number else f"<td>{escape(text)}</td>"


def markdown_page(title: str, introduction: str, sections: Sequence[ReportSection], footer: str) -> str:
    """The page, as docs/measured/paper.md is made; rows of tables stay on one line, however long."""
    parts = [f"# {title}", _wrapped(introduction)]
    for section in sections:
        parts += [f"## {section.title}", _wrapped(section.text)]
        if section.rows:
            parts.append(_markdown_table(ROW_HEAD, section.rows))
        for table in section.tables:
            parts += [_wrapped(f"{table.title}:"), _markdown_table(table.head, table.rows)]
    return "\n\n".join([*parts, _wrapped(footer)]) + "\n"


def _wrapped(text: str) -> str:
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def _markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [_markdown_line(head), "|" + "---|" * len(head), *(_markdown_line(row) for row in rows)]
    return "\n".join(lines)


def _markdown_line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
