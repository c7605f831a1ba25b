"""Draw frequencies of OC and CC while the study's explorations are drawn at the paper's speed."""

from ..reports.file_summary import DRAW_FREQUENCIES, draw_frequencies
from ..reports.report_pages import ReportSection, ReportTable
from .compared_rows import ReportRow, compared
from .explorations import FeltLengths
from .paper_numbers import SPEED

TEXT = (
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
    rows = tuple(_row(name, found) for name, found in values.items())
    head = ("object", "strategy", "headline [Hz]", "5 % [Hz]", "median [Hz]", "95 % [Hz]", "of mean length [Hz]")
    table = tuple(
        (name, strategy.upper(), *(_number(found[key]) for key in DRAW_FREQUENCIES))
        for name, by_strategy in values.items()
        for strategy, found in by_strategy.items()
    )
    section = ReportSection(
        "Sections 4.2 and 4.3: draw frequencies", TEXT, (compared(rows), ReportTable("Draw frequencies", head, table))
    )
    return section, {"draw_frequency": values}


def _row(name: str, found: dict) -> ReportRow:
    low, high = found["cc"]["draw_frequency_of_mean_length"], found["oc"]["draw_frequency_of_mean_length"]
    headline = found["oc"]["draw_frequency"], found["cc"]["draw_frequency"]
    ours = f"OC {_number(headline[0])} Hz, CC {_number(headline[1])} Hz (headline)"
    verdict = "No contour was met"
    if low is not None and high is not None:
        verdict = "Agrees" if low < high else "Disagrees"
        ours += f"; of mean length OC {high:.1f} Hz, CC {low:.1f} Hz"
    why = (
        f"{verdict}: the paper gives the speed and the order, no frequencies. The headline of OC is raised by poses "
        "that only graze the object, whose contours are a few millimetres long."
    )
    return ReportRow(f"draw frequency, {name}", f"{SPEED:g} m/s; CC lower than OC", ours, why)


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.1f}"
