"""The page of a picture: exactly as wide as asked for, filled from its top down, with texts cut to their room."""

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import Any

from ...datasets.known_names import find_name, unknown_name
from ..errors import StrategyError
from ..terminal.foreign_text import visible
from ..validation import require_number

INCH = 0.0254  # [m]
WIDTHS = {"single": 0.089, "double": 0.183, "ieee-single": 3.5 * INCH, "ieee-double": 7.16 * INCH}
"""[m] of columns in print: Nature's (89 and 183 mm), and those of the IEEE's journals (3.5 and 7.16 inches)."""
WIDTH_USUAL, WIDTH_LEAST, WIDTH_MOST = 9.6 * INCH, 0.06, 0.6  # [m]
FONT_USUAL, FONT_LEAST, FONT_MOST = 8.0, 4.0, 14.0  # [pt]
EDGE, GAP = 0.1, 0.1  # [inch] margin around everything, and between parts
LINE, ROW = 1.3, 1.65  # of the font's size: from one line of text to the next, from one row of a legend to the next
HANDLE, PAD, COLUMN = 2.6, 0.6, 1.6  # of the font's size: mark of a legend, from there to its text, between columns
DPI = 300  # at which texts are measured

Entry = tuple[Any, str]
"""What a legend shows: a mark and its meaning."""


def width_of(width: float | str | None) -> float:
    """A picture's width [m] by the name of a column or as a number; raises StrategyError for another one."""
    if isinstance(width, str):
        if (name := find_name(width, WIDTHS)) is not None:
            return WIDTHS[name]
        try:
            width = float(width)
        except ValueError:
            columns = ", ".join(f"{name} ({1e3 * metres:.1f} mm)" for name, metres in WIDTHS.items())
            raise StrategyError(f"{unknown_name('width', width, WIDTHS)}; or a number of metres. {columns}") from None
    if width is None:
        return WIDTH_USUAL
    require_number("width", width, WIDTH_LEAST, WIDTH_MOST, unit="m")
    return float(width)


def font_of(size: float | None) -> float:
    """Size of a picture's texts [pt]; raises StrategyError for one that is out of range."""
    if size is None:
        return FONT_USUAL
    require_number("font size", size, FONT_LEAST, FONT_MOST, unit="points")
    return float(size)


def text_width(text: str, size: float, *, bold: bool = False) -> float:
    """Width of a line of text [inch], as matplotlib's renderer measures it; size: [pt]."""
    from matplotlib.backends.backend_agg import RendererAgg
    from matplotlib.font_manager import FontProperties

    font = FontProperties(family="DejaVu Sans", size=size, weight="bold" if bold else "normal")
    return RendererAgg(1, 1, DPI).get_text_width_height_descent(text, font, ismath=False)[0] / DPI


def fit_text(text: str, width: float, size: float, *, lines: int = 1, bold: bool = False) -> str:
    """A text on at most so many lines that are no wider than `width` [inch], without its middle where it is longer.

    Lines end between words where that is possible. size: [pt].
    """

    def fits(part: str) -> bool:
        return text_width(part, size, bold=bold) <= width

    rest, out = visible(" ".join(text.split())), []
    while len(out) < lines - 1 and not fits(rest):
        count = bisect_right(range(1, len(rest) + 1), width, key=lambda n: text_width(rest[:n], size, bold=bold))
        space = rest.rfind(" ", 0, count + 1)
        end = space if space > 0 else max(count, 1)
        out.append(rest[:end])
        rest = rest[end:].lstrip()
    kept, line = len(rest), rest
    while kept and not fits(line):
        kept -= 1
        line = f"{rest[: (kept + 1) // 2]}…{rest[len(rest) - kept // 2 :]}"
    return "\n".join([*out, line])


class Page:
    """A matplotlib figure whose parts have places in inches from its left and its top.

    Its height is known when all parts are placed: `finish` sets it, and only then may artists be drawn that depend on
    the size of their axes.
    """

    def __init__(self, width: float, font: float) -> None:
        """width: [m]; font: size of all texts [pt]."""
        from matplotlib.figure import Figure

        self.width, self.font = width / INCH, font
        self.line = LINE * font / 72
        self.figure = Figure(figsize=(self.width, 1.0))
        self._placed: list[tuple[Callable[[Any], object], Sequence[float]]] = []

    @property
    def inner(self) -> float:
        """Width between the margins [inch]."""
        return self.width - 2 * EDGE

    def axes(self, left: float, top: float, width: float, height: float) -> Any:
        """Add axes [inch]."""
        axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        # Ticks are made while the figure is drawn, by the settings of that time.
        axes.tick_params(labelsize=self.font, pad=max(3.0, 0.45 * self.font))
        self._placed.append((axes.set_position, (left, top, width, height)))
        return axes

    def text(self, text: str, left: float, top: float, width: float, *, lines: int = 1, **look: Any) -> float:
        """Add a text within a width [inch]; returns its height."""
        shown = fit_text(text, width, self.font, lines=lines, bold=look.get("fontweight") == "bold")
        look |= {"fontsize": self.font, "linespacing": LINE / 1.17, "parse_math": False}
        height = self.line * (1 + shown.count("\n"))
        # The base of the last line, so that texts beside each other stand on one line whatever their letters are.
        base = top + height - self.line + 0.95 * self.font / 72
        self._placed.append((self.figure.text(0, 0, shown, **look).set_position, (left, base)))
        return height

    def row(self, texts: Sequence[str], lefts: Sequence[float], top: float, width: float, **look: Any) -> float:
        """Add texts beside each other; returns the height of the highest."""
        return max(self.text(text, left, top, width, **look) for text, left in zip(texts, lefts, strict=True))

    def legend_width(self, entries: Sequence[Entry]) -> float:
        """Width that a legend of one column takes [inch]."""
        widest = max((text_width(text, self.font) for _, text in entries), default=0.0)
        return widest + (HANDLE + PAD) * self.font / 72

    def legend(self, entries: Sequence[Entry], left: float, top: float, width: float) -> float:
        """Add a legend in as many columns as fit into a width [inch]; returns its height."""
        from matplotlib.legend_handler import HandlerTuple

        if not entries:
            return 0.0
        em = self.font / 72
        room = width - (HANDLE + PAD) * em
        texts = [fit_text(text, room, self.font) for _, text in entries]
        widest = min(width, self.legend_width(entries))
        columns = max(1, min(len(texts), math.floor((width + COLUMN * em) / (widest + COLUMN * em))))
        rows = -(-len(texts) // columns)
        legend = self.figure.legend(
            [mark for mark, _ in entries], texts, loc="upper left", ncols=columns, frameon=False, fontsize=self.font,
            handlelength=HANDLE, handletextpad=PAD, columnspacing=COLUMN, labelspacing=0.4, borderpad=0,
            borderaxespad=0, handler_map={tuple: HandlerTuple(ndivide=None, pad=0)},
        )  # fmt: skip
        for text in legend.get_texts():
            text.set_parse_math(False)  # names of files are no formulas
        self._placed.append((legend.set_bbox_to_anchor, (left, top)))
        return rows * ROW * em

    def finish(self, height: float) -> None:
        """Give the page its height [inch], and its parts their places."""
        self.figure.set_size_inches(self.width, height)
        for place, (left, top, *size) in self._placed:
            if size:
                place((left / self.width, 1 - (top + size[1]) / height, size[0] / self.width, size[1] / height))
            else:
                place((left / self.width, 1 - top / height))
