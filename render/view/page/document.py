"""The HTML around what a page shows: script, style and data in one document that loads nothing and obeys no name."""

import base64
import hashlib
import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import Any

from ...errors import ViewError
from ...terminal.foreign_text import visible

ASSETS = ("page.js", "page.css", "LICENCES.txt")


def served_document(sockets: list[str]) -> str:
    """The page without data, which it asks for over one of these WebSockets."""
    return document({"served": True}, "", "palpate", sockets)


def document(
    described: dict[str, Any], content: str, title: str, sockets: Sequence[str] = (), language: str = "en"
) -> str:
    """The page. described: what JSON takes, all foreign text in it. content: base64 of its arrays.

    sockets: addresses of WebSockets that it may open; without any, it connects to nothing. language: of its words, as
    HTML's `lang`.

    The browser runs and applies exactly the script and the style whose SHA-256 the page names, and fetches nothing
    (Content-Security-Policy). Names are data: they stand in JSON without `<`, and the script shows them as text.
    """
    script, style, licences = (_asset(name) for name in ASSETS)
    connected = " ".join(sockets) or "'none'"
    policy = (
        f"default-src 'none'; script-src {_digest(script)}; style-src {_digest(style)}; img-src data:; "
        f"connect-src {connected}; base-uri 'none'; form-action 'none'"
    )
    # JSON in ASCII in which nothing can end the element that it stands in, or begin a comment.
    json_text = json.dumps(described, separators=(",", ":"), allow_nan=False)
    json_text = json_text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    return (
        f'<!DOCTYPE html>\n<html lang="{escape(language)}">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="referrer" content="no-referrer">\n<link rel="icon" href="data:,">\n'
        f"<title>{escape(visible(title))}</title>\n<style>{style}</style>\n</head>\n<body>\n"
        '<div id="page"><noscript>This page draws contours with JavaScript, which this browser has turned off.'
        "</noscript></div>\n"
        f'<script type="text/plain" id="licences">{licences}</script>\n'
        f'<script type="application/json" id="described">{json_text}</script>\n'
        f'<script type="text/plain" id="content">{content}</script>\n'
        f"<script>{script}</script>\n</body>\n</html>\n"
    )


def _asset(name: str) -> str:
    try:
        text = files(__package__).joinpath("assets", name).read_text("utf-8")
    except OSError as error:
        raise ViewError(f"the page's {name} is missing from this installation of palpate ({error})") from error
    if "</script" in text.lower() or "</style" in text.lower() or "<!--" in text:
        raise ViewError(f"the page's {name} would end where it must not; it was not built for palpate")
    return text


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
