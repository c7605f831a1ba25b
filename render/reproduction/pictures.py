"""Matplotlib figures as data URIs, which a page holds without a file beside it."""

import io
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

STYLE = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "palpate",  # else ids differ from run to run
}
FORMATS = {"svg": "svg+xml", "png": "png"}


@contextmanager
def drawing(width: float, height: float) -> Iterator[Any]:
    """A figure of this size [inch] in the report's style."""
    import matplotlib as mpl  # 0.7 s that only pictures cost
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        yield Figure(figsize=(width, height), layout="constrained")


def picture_uri(figure: Any, kind: str = "svg") -> str:
    """The figure as a data URI; kind: svg, or png for what has very many parts. Call it inside `drawing`."""
    content = io.BytesIO()
    unstamped = {"Date": None, "Creator": None, "Type": None, "Format": None} if kind == "svg" else None
    figure.savefig(content, format=kind, dpi=150, metadata=unstamped)
    return f"data:image/{FORMATS[kind]};base64,{b64encode(content.getvalue()).decode()}"
