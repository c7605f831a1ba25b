"""Shows examples in docstrings as code; mkdocs.yml names this file as an extension of Griffe.

Griffe takes `>>>` for code only under a heading `Examples:`, which this project's docstrings do not have. Without this,
a result such as [0, 1] would be read as a link.
"""

import re
from typing import Any

import griffe

EXAMPLE = re.compile(r"(?:^>>> .*\n?(?:^(?!\s*$).*\n?)*)+", re.MULTILINE)


class ExamplesAsCode(griffe.Extension):
    """Fences each example; `[0, 0, 0] [m]` in a sentence is no link either."""

    def on_instance(self, *, obj: griffe.Object | griffe.Alias, **_: Any) -> None:
        """Change the docstring of what was found."""
        if not obj.is_alias and obj.docstring:
            text = re.sub(r"\](\s?)\[", r"]\1\[", obj.docstring.value)
            obj.docstring.value = EXAMPLE.sub(_fence, text)


def _fence(found: re.Match[str]) -> str:
    return "```pycon\n{}\n```\n".format(
        found[0].rstrip().replace("]\\[", "][").replace("] \\[", "] [")
    )
