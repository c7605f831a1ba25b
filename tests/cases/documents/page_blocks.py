"""Blocks of code of the documents, found as Markdown has them."""

import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[3]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHELL = ("sh", "bash")  # languages of blocks whose lines are commands, as those of indented blocks are
NAMED = re.compile(r'\btitle="([^"]+)"')


class Block(NamedTuple):
    """A fenced or indented block of code."""

    page: Path
    line: int
    language: str
    marks: str
    text: str
    indented: bool

    @property
    def name(self) -> str | None:
        """The file that this block is: its title, or a first line `# NAME.py`."""
        if titled := NAMED.search(self.marks):
            return titled[1]
        first = re.match(r"# (\w+\.\w+)\n", self.text)
        return first[1] if first else None

    @property
    def place(self) -> str:
        """For messages and names of tests."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


@cache
def blocks_of(page: Path) -> list[Block]:
    """All blocks of a page, also those within lists and quotations."""
    found = []
    for token in MarkdownIt().parse(page.read_text()):
        if token.type in ("fence", "code_block"):
            language, _, marks = token.info.strip().partition(" ")
            found.append(Block(page, token.map[0] + 1, language, marks, token.content, token.type == "code_block"))
    return found


def commands_in(block: Block) -> list[str]:
    """Lines of a block that one types into a shell; a line that ends in a backslash goes on in the next."""
    lines = re.sub(r"\\\n\s*", "", block.text).splitlines() if block.indented or block.language in SHELL else []
    return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def command_lines(page: Path) -> list[str]:
    """Lines of a page that one types into a shell."""
    return [line for block in blocks_of(page) for line in commands_in(block)]


def spans_of(page: Path) -> list[str]:
    """Code within the sentences of a page, each on one line."""
    inline = [token for token in MarkdownIt("commonmark").enable("table").parse(page.read_text()) if token.children]
    return [child.content for token in inline for child in token.children if child.type == "code_inline"]
