"""Section 4.3.2 and figure 4: the noise of OC beside that of CC, and their spectra beside the paper's."""

from typing import Any

import numpy as np

from ..reports.report_pages import ReportPicture, ReportSection, drawing, picture_content
from .compared_rows import ReportRow, compared
from .noise_recordings import SHAPE_BAND, NoiseComparison, paper_above
from .paper_numbers import NOISE_BANDS, NOISE_PEAK, NOISE_RMS, paper_spectra
from .significance import p_text

SHOWN_BAND = (40.0, 12_000.0)
"""Frequencies of the picture [Hz]."""
NAMES = {
    "db_300_10k": "300 Hz to 10 kHz",
    "db_40_300": "40 to 300 Hz",
    "dba": "A-weighted",
    "rms": "RMS",
    "peak": "peak",
}
PAPER = {**NOISE_BANDS, "rms": NOISE_RMS, "peak": NOISE_PEAK}


def noise_section(found: NoiseComparison, text: str, why: dict[str, str]) -> tuple[ReportSection, dict]:
    """The section, and its values for JSON.

    text: how the recordings were made, in a few sentences. why: by quantity (the keys of NAMES, `above` and `shape`),
    why palpate's differs from the paper's.
    """
    values, tests = found.values(), found.tests()
    rows = []
    for name, words in NAMES.items():
        p = tests[name]
        ours = f"{values[name]:+.2f} dB (t-test {p_text(p['t_test_p'])}; Shapiro {p_text(p['shapiro_p'])})"
        paper = f"{PAPER[name]:+.1f} dB" if name not in ("rms", "peak") else f"{PAPER[name]:+.2f} dB, p > 0.05"
        rows.append(ReportRow(f"OC - CC, {words}", paper, ours, why[name]))
    ours = f"{found.above(False):+.1f} dB; {found.above(True):+.1f} dB with the paper's background in both"
    rows.append(ReportRow("OC - CC, 1 to 10 kHz", f"{paper_above():+.1f} dB", ours, why["above"]))
    low, high = SHAPE_BAND
    ours = f"{found.shape_error:.1f} dB rms from the paper, {low:g} to {high:g} Hz"
    rows.append(ReportRow("shape of OC's spectrum", "figure 4B", ours, why["shape"]))
    above = {"db_1k_10k": found.above(False), "db_1k_10k_with_background": found.above(True)}
    section = ReportSection("Section 4.3.2 and figure 4: audible noise", text, (compared(rows),), (_picture(found),))
    return section, {"noise": {**values, "shape_error": found.shape_error, **above, "tests": tests}}


def _picture(found: NoiseComparison) -> ReportPicture:
    at, closed, opened = paper_spectra()
    here = (found.frequency >= SHOWN_BAND[0]) & (found.frequency <= SHOWN_BAND[1])
    shift = found.shift  # neither has a reference
    panels = (
        ("A: CC", closed, found.closed + shift, "level [dB]"),
        ("B: OC", opened, found.open + shift, "level [dB]"),
        ("C: OC - CC", opened - closed, found.open - found.closed, "difference [dB]"),
    )
    with drawing(10.0, 3.3) as figure:
        drawn = figure.subplots(1, 3)
        for axes, (title, paper, ours, unit) in zip(drawn, panels, strict=True):
            _draw_spectrum(axes, (at, paper), (found.frequency[here], ours[here]))
            axes.set_title(title, fontsize=10, loc="left")
            axes.set_ylabel(unit)
        handles, labels = drawn[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
        content = picture_content(figure)
    alt = "Spectra of CC, of OC and their difference: palpate's as lines, the paper's as dots"
    caption = f"Spectra (the paper's figure 4). palpate's levels are moved by {shift:+.1f} dB, one value for OC and CC."
    return ReportPicture(content, alt, caption)


def _draw_spectrum(axes: Any, paper: tuple[np.ndarray, np.ndarray], ours: tuple[np.ndarray, np.ndarray]) -> None:
    axes.plot(*ours, color="#1d6fa5", lw=1.2, label="palpate")
    axes.plot(*paper, "o", ms=3.5, color="#c1121f", label="paper, 30 points of its vectors")
    axes.set_xscale("log")
    axes.set_xlim(*SHOWN_BAND)
    axes.set_xlabel("frequency [Hz]")
    axes.grid(alpha=0.2)
