"""Sections 5.2 and 6.2: what the paper's participants felt, which is not made again without people."""

from ..reports.report_pages import ReportSection, ReportTable

TEXT = (
    "No computation answers for people. Both studies can be run again with participants: `palpate study example paper` "
    "writes the user study's plan, `palpate study paper.toml` runs the next participant, and `palpate study analyse "
    "paper.toml` makes a report with the tests of these rows. The pilot's plan is `palpate study example pilot`."
)
NEEDED = "needs people"
ROWS = (
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
    rows = tuple((what, paper, NEEDED, how) for what, paper, how in ROWS)
    table = ReportTable("", ("result", "paper", "palpate", "section of a study's report"), rows, "compare")
    return ReportSection("Sections 5.2 and 6.2: what people felt", TEXT, (table,))
