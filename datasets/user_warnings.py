"""Warnings that name the reader's own line: the one outside palpate that led to them."""

import sys
import warnings

PACKAGE = __name__.partition(".")[0]


def warn_user(message: str, category: type[Warning]) -> None:
    """Warn at the innermost line that is not palpate's."""
    level, frame = 1, sys._getframe()  # pyright: ignore[reportPrivateUsage]  # as the standard library does before Python 3.12
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] == PACKAGE:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)
