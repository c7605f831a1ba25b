"""Matplotlib figures of reports: one style, and their bytes, which a page holds without a file beside it."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

STYLE = {
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

    with mpl.rc_context(STYLE):
        yield Figure(figsize=(width, height), layout="constrained")


def picture_content(figure: Any, kind: Literal["svg", "png"] = "svg") -> bytes:
    """The figure as a file, the same bytes each time; its texts are outlines. Call it inside `drawing`.

    kind: png for what has very many parts.
    """
    content = io.BytesIO()
    unstamped = {"Date": None, "Creator": None, "Type": None, "Format": None} if kind == "svg" else None
    figure.savefig(content, format=kind, dpi=150, metadata=unstamped)
    return content.getvalue()
