"""Figure 6C: distributions of r by object, beside the paper's means."""

from typing import Any

import numpy as np

from ..reports.report_pages import ReportPicture, ReportSection, ReportTable, drawing, picture_content
from .compared_rows import ReportRow, compared
from .explorations import StudySettings
from .length_ratios import BlockRatios, ratio_tests, ratio_values
from .paper_numbers import ALPHA, RATIOS
from .significance import p_text

AIM = 0.1
"""Of the paper's mean: how near r should come with nothing fitted."""
COLOUR, PAPER_COLOUR = "#1d6fa5", "#c1121f"
READINGS = {"r": "a palm wholly inside counts as its whole boundary", "r_open": "it counts as nothing"}

TEXT = (
    "Each dot is one block of one explorer, as in the paper: {repetitions} explorations of 7 s with CC. r is the mean "
    "length of CC over the mean length of OC, of all poses of the block. {explorers} explorers with two blocks an "
    "object make {dots} dots an object. The paper says that CC closes open contours, and a palm wholly inside the "
    "object has none. So r is given in two readings of CC: such a palm counts as its whole boundary (r), or as nothing "
    "(r_open). The palm is {width:.0f} x {length:.0f} mm. Nothing is fitted; "
    "other workspaces, palms and models of explorers give the ranges in the rows."
)

WHY = (
    "{verdict}. The paper gives neither the palm's size nor the hands' paths: the palm is an assumption, the paths are "
    "synthetic explorations."
)
ALTERNATIVES = {"cube": "2.39 to 3.06", "tube": "1.48 to 1.66", "dog": "1.13 to 1.29"}
"""r over all explorers of docs/measured/explorers.md: workspaces, palms, tilted hands, another model."""
WHY_MESH = {
    "cube": " CC and OC differ most where a palm is wholly inside: the two readings show how much rests on that.",
    "tube": " The paper gives the triangles (256); its inner radius was read off figure 5B.",
    "dog": " The paper does not publish its mesh of 136 triangles: palpate's is its own, and a thicker one raises r.",
}


def ratio_section(ratios: dict[str, BlockRatios], settings: StudySettings) -> tuple[ReportSection, dict]:
    """The section, and its values for JSON: r, r_open and the tests of both."""
    readings = {
        "r": {name: both.whole for name, both in ratios.items()},
        "r_open": {name: both.open for name, both in ratios.items()},
    }
    values: dict[str, Any] = {reading: ratio_values(r) for reading, r in readings.items()}
    tests = {reading: ratio_tests(r) for reading, r in readings.items()}
    for name, summary in values["r"].items():
        summary["paper"] = RATIOS[name]
    rows = [_object_row(name, values["r"][name], values["r_open"][name]) for name in ratios]
    shapiro = "; ".join(f"{name}: {p_text(summary['shapiro_p'])}" for name, summary in values["r"].items())
    why = "The paper tests normality of other data only. Wilcoxon's test does not need it."
    rows += [
        _test_row(tests["r"]),
        ReportRow("r is normally distributed (Shapiro)", "not given", shapiro, why),
    ]
    text = TEXT.format(
        repetitions=settings.repetitions,
        explorers=settings.explorers,
        dots=next(iter(ratios.values())).whole.size,
        width=1e3 * settings.palm.width,
        length=1e3 * settings.palm.length,
    )
    section = ReportSection(
        "Figure 6C: r, how much longer CC is than OC",
        text,
        (compared(rows), _distribution_table(values)),
        (_picture(readings),),
    )
    return section, {**values, "r_tests": tests["r"], "r_open_tests": tests["r_open"]}


def _object_row(name: str, whole: dict, opened: dict) -> ReportRow:
    ours = f"r = {_spread(whole)}; r_open = {_spread(opened)}"
    verdict = "No r: nothing was drawn with OC"
    if whole["mean"] is not None:
        off = whole["mean"] / RATIOS[name] - 1.0, opened["mean"] / RATIOS[name] - 1.0
        near = "r is within" if abs(off[0]) <= AIM else "r is not within"
        verdict = f"{near} {100 * AIM:.0f} % of the paper ({100 * off[0]:+.0f} %; r_open {100 * off[1]:+.0f} %)"
    why = WHY.format(verdict=verdict) + WHY_MESH[name]
    why += f" Over the alternatives of docs/measured/explorers.md r is {ALTERNATIVES[name]}."
    return ReportRow(f"r, {name}", f"{RATIOS[name]:.2f}", ours, why)


def _test_row(tests: dict[str, dict[str, float | None]]) -> ReportRow:
    ours = "; ".join(f"{pair}: {p_text(p)}" for pair, p in tests["by_block"].items())
    means = "; ".join(f"{pair}: {p_text(p)}" for pair, p in tests["by_explorer"].items())
    why = (
        f"The paper tests blocks. The two blocks of an explorer are not independent, though, so that p comes out too "
        f"small; the means of each explorer are. With these: {means}."
    )
    paper = f"p < {ALPHA:g} for all pairs"
    return ReportRow("pairs of objects differ in r (Wilcoxon, Holm)", paper, ours, why)


def _distribution_table(values: dict[str, dict]) -> ReportTable:
    rows = []
    for reading, words in READINGS.items():
        for name, found in values[reading].items():
            numbers = [_number(found[key]) for key in ("mean", "sd", "lowest", "highest")]
            rows.append((f"{reading}: {words}", name, *numbers, str(found["blocks"])))
    head = ("reading", "object", "mean", "standard deviation", "lowest", "highest", "blocks")
    return ReportTable("Distributions of r over blocks", head, tuple(rows))


def _spread(summary: dict) -> str:
    """Mean and standard deviation."""
    return _number(summary["mean"]) + ("" if summary["sd"] is None else f" ± {summary['sd']:.2f}")


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.2f}"


def _picture(readings: dict[str, dict[str, np.ndarray]]) -> ReportPicture:
    with drawing(9.0, 3.6) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        for axes, (reading, ratios) in zip(panels, readings.items(), strict=True):
            for place, (name, r) in enumerate(ratios.items()):
                _draw_sample(axes, place, r[np.isfinite(r)], RATIOS[name])
            axes.axhline(1.0, color="#999999", lw=0.6, ls=":")
            axes.set_xticks(range(len(ratios)), list(ratios))
            axes.set_xlim(-0.6, len(ratios) - 0.4)
            axes.set_title(f"{reading}: {READINGS[reading]}", fontsize=9, loc="left")
        panels[0].set_ylabel("r = mean |CC| / mean |OC|")
        handles, labels = panels[0].get_legend_handles_labels()
        unique = dict(zip(labels, handles, strict=True))
        figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=3, frameon=False)
        content = picture_content(figure)
    alt = (
        "Strip and violin plots of r for cube, tube and dog in two readings of CC, with palpate's and the paper's means"
    )
    return ReportPicture(content, alt, "Distributions of r over the blocks of all explorers (the paper's figure 6C).")


def _draw_sample(axes: Any, place: int, r: np.ndarray, paper: float) -> None:
    """A violin, its dots beside each other, the mean, and the paper's mean."""
    if len(r) > 2 and np.ptp(r) > 0.0:
        parts = axes.violinplot(r, positions=[place], widths=0.7, showextrema=False)
        parts["bodies"][0].set(facecolor=COLOUR, alpha=0.18, edgecolor="none")
    across = place + 0.44 * (np.modf(np.arange(1, len(r) + 1) * 0.6180339887)[0] - 0.5)
    axes.plot(across, r, ".", ms=4, color="#222222", alpha=0.75, label="a block of an explorer")
    mean = {"marker": "D", "ls": "", "ms": 7, "mfc": "white", "mec": COLOUR, "mew": 1.4}
    if len(r):
        axes.plot([place], [r.mean()], **mean, label="mean, palpate", zorder=4)
    axes.plot([place - 0.36, place + 0.36], [paper, paper], color=PAPER_COLOUR, lw=2, label="mean, paper", zorder=3)
