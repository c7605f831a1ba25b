"""Sections 4.2, 5.2 and 6.2 and figure 6C: draw frequencies, r, and what people felt."""

from typing import Any

import numpy as np

from ..reports.file_summary import DRAW_FREQUENCIES, draw_frequencies
from ..reports.picture_style import DPI, picture_bytes
from ..reports.report_pages import ReportPicture, ReportSection, ReportTable, drawing
from .explorations import BlockRatios, FeltLengths, StudySettings, p_text, ratio_tests, ratio_values
from .paper_numbers import ALPHA, RATIOS, SPEED, ReportRow, compared

FREQUENCY_TEXT = (
    "The focal point moves at 7 m/s, so a longer contour is drawn at a lower frequency. All values are of the poses of "
    "the explorations below that have a contour. The headline is the mean over these poses of update rate by whole "
    "samples of a cycle; the others are its 5 %, 50 % and 95 % quantiles, and speed by mean length."
)


def frequency_section(lengths: dict[str, FeltLengths]) -> tuple[ReportSection, dict]:
    """The section, and its values for JSON: draw frequencies [Hz] by object and strategy."""
    values = {
        name: {
            strategy: draw_frequencies(length[length > 0.0])
            for strategy, length in (("oc", felt.open), ("cc", felt.closed))
        }
        for name, felt in lengths.items()
    }
    rows = tuple(_frequency_row(name, found) for name, found in values.items())
    head = ("object", "strategy", "headline [Hz]", "5 % [Hz]", "median [Hz]", "95 % [Hz]", "of mean length [Hz]")
    table = tuple(
        (name, strategy.upper(), *(_frequency_text(found[key]) for key in DRAW_FREQUENCIES))
        for name, by_strategy in values.items()
        for strategy, found in by_strategy.items()
    )
    section = ReportSection(
        "Sections 4.2 and 4.3: draw frequencies",
        FREQUENCY_TEXT,
        (compared(rows), ReportTable("Draw frequencies", head, table)),
    )
    return section, {"draw_frequency": values}


def _frequency_row(name: str, found: dict) -> ReportRow:
    low, high = found["cc"]["draw_frequency_of_mean_length"], found["oc"]["draw_frequency_of_mean_length"]
    headline = found["oc"]["draw_frequency"], found["cc"]["draw_frequency"]
    ours = f"OC {_frequency_text(headline[0])} Hz, CC {_number(headline[1])} Hz (headline)"
    verdict = "No contour was met"
    if low is not None and high is not None:
        verdict = "Agrees" if low < high else "Disagrees"
        ours += f"; of mean length OC {high:.1f} Hz, CC {low:.1f} Hz"
    why = (
        f"{verdict}: the paper gives the speed and the order, no frequencies. The headline of OC is raised by poses "
        "that only graze the object, whose contours are a few millimetres long."
    )
    return ReportRow(f"draw frequency, {name}", f"{SPEED:g} m/s; CC lower than OC", ours, why)


def _frequency_text(value: float | None) -> str:
    return "none" if value is None else f"{value:.1f}"


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
        content = picture_bytes(figure, "svg", dpi=DPI)
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


PEOPLE_TEXT = (
    "No computation answers for people. Both studies can be run again with participants: `palpate study example paper` "
    "writes the user study's plan, `palpate study paper.toml` runs the next participant, and `palpate study analyse "
    "paper.toml` makes a report with the tests of these rows. The pilot's plan is `palpate study example pilot`."
)
NEEDED = "needs people"
PEOPLE_ROWS = (
    ("p_CC above 0.5 (Wilcoxon)", "p < 0.001", "Choices: p_cc, test against chance"),
    ("p_CC is normally distributed (Shapiro)", "p < 0.001", "Choices: p_cc, Shapiro-Wilk test of all blocks"),
    ("p_CC by object (Wilcoxon, Holm)", "cube above tube, p = 0.03", "Choices: p_cc, pairs of objects"),
    ("p_CC by opacity (Wilcoxon)", "opaque above transparent, p = 0.006", "Choices: p_cc, pair of opacities"),
    (
        "p_CC of each participant",
        "12 of 18 with 0.5 or more in at least 5 of 6 blocks; 3 opposite; 3 ambiguous",
        "Choices: p_cc, table and picture of participants",
    ),
    (
        "confidence by object (Wilcoxon, Holm)",
        "cube above dog, p = 0.005; above tube, p = 0.012",
        "Confidence, pairs of objects",
    ),
    (
        "difficulty by object (Wilcoxon, Holm)",
        "cube easier than dog and than tube, p = 0.004 both",
        "Difficulty, pairs of objects",
    ),
    (
        "confidence and difficulty by opacity (Wilcoxon)",
        "no significant effect, p = 0.05 both (as printed)",
        "Confidence, Difficulty, pair of opacities",
    ),
    (
        "pilot: OC and CC feel different (of 6 participants, 5 objects each)",
        "2 always, 2 failed once, 2 failed twice",
        "What people wrote, question stimuli",
    ),
    (
        "pilot: what differs",
        "density and filling, named at least once by all 6",
        "What people wrote, question objects",
    ),
    (
        "pilot: which one fits what is seen",
        "CC in most answers of 5 of 6",
        "What people wrote, question coherence",
    ),
)
"""Result, what the paper reports, and the section of a study's report that has it."""


def people_section() -> ReportSection:
    """The section; it has no values."""
    rows = tuple((what, paper, NEEDED, how) for what, paper, how in PEOPLE_ROWS)
    table = ReportTable("", ("result", "paper", "palpate", "section of a study's report"), rows, "compare")
    return ReportSection("Sections 5.2 and 6.2: what people felt", PEOPLE_TEXT, (table,))
