"""The page on a study's analysis: columns, assumptions and notes are those of the code; its Python runs."""

import ast
import re

import pytest
from answered_tables import PAPER, QUESTION, chosen, levels_text, option, paper_answers, plan_of, table_of
from page_blocks import ROOT
from simulated_participants import observed_table
from study_observers import paper_observers

from palpate.render.study.analysis import psychometric_fit, report_sections
from palpate.render.study.analysis.command import answer_columns, fit_columns, measure_columns, outcome_columns
from palpate.render.study.analysis.study_analysis import analyse_answers
from palpate.render.study.plan.study_plan import example_text
from palpate.render.study.plan.study_reading import read_stored_study

PAGE = ROOT / "docs" / "formats" / "study-analysis.md"
FACTOR = "block_FACTOR"
EXAMPLES = {"FARTHEST": "10", "mu.value": "12", "' and no '.join(missing)": "lower"}
"""What stands in the page for a value that a note is made with."""


def rows_below(heading):
    """Rows of the first table below a heading, each a list of cells."""
    text = re.split(rf"^#+ {re.escape(heading)}\n", PAGE.read_text(), flags=re.MULTILINE)[1]
    table = re.search(r"(?:^\|.*\n)+", text, re.MULTILINE)[0]
    return [[cell.strip() for cell in line.strip("| \n").split(" | ")] for line in table.splitlines()[2:]]


def paper_table():
    """Answers of two participants to the founding paper's plan."""
    plan = plan_of(PAPER.replace("participants = 3", "participants = 2"))
    return table_of(plan, *(paper_answers(code, ["1110110101 5 3"] * 6) for code in plan.codes))


def fitted_table():
    """Answers of one participant to all that functions are fitted to, of a plan whose first block has a level."""
    plan = plan_of(
        levels_text([1, 2, 3]),
        f'[[block]]\nfor = {{ side = ["left"] }}\nname = "c-{{side}}"\ndesign = "constant"\nstandard = "s2"\n'
        f'comparisons = ["s1", "s3"]\n{QUESTION}\n',
        f'[[block]]\nname = "y"\ndesign = "constant"\ncomparisons = ["s1", "s2"]\noptions = ["no", "yes"]\n'
        f"{QUESTION}\n",
        '[[block]]\nname = "t"\ndesign = "staircase"\nlevels = ["s3", "s2", "s1"]\noptions = ["no", "yes"]\n'
        f'correct = "yes"\n{QUESTION}\n',
    )
    pair = chosen("P01", "c-left", ("s2", "s3"), "1101")
    return table_of(
        plan,
        [own._replace(comparison=own.stimuli.index("s3")) for own in pair],
        option("P01", "y", 0, 1, ("no", "yes"), ("s2",)),
        option("P01", "t", 0, 1, ("no", "yes"), ("s3",), level=0),
    )


MADE = {
    "answers": lambda: answer_columns(paper_table()),
    "measures": lambda: measure_columns(analyse_answers(paper_table())),
    "tests": lambda: outcome_columns(analyse_answers(paper_table())),
    "fits": lambda: fit_columns(analyse_answers(fitted_table())),
}


@pytest.mark.parametrize("name", MADE)
def test_the_page_lists_the_columns_of_each_table_in_their_order(name):
    listed = [own for row in rows_below(name) for own in re.findall(r"`(\w+)`", row[0])]
    levels = r"block_(?:object|opacity|side)"
    made = list(dict.fromkeys(FACTOR if re.fullmatch(levels, own) else own for own in MADE[name]()))
    assert listed == made


@pytest.mark.parametrize("table", [paper_table, fitted_table])
def test_the_page_lists_every_measure(table):
    listed = {own for row in rows_below("What is measured") for own in re.findall(r"`(\w+)`", row[0])} | {"difficulty"}
    assert {own.measure.name for own in analyse_answers(table()).tests} <= listed


def test_the_tutorial_quotes_the_report_of_simulated_people(monkeypatch):
    for name in [own for own in vars(report_sections) if own.startswith("draw_")]:
        monkeypatch.setattr(report_sections, name, lambda *values, **options: None)
    plan = read_stored_study(example_text("paper"), "paper.toml")
    analysis = analyse_answers(observed_table(plan, paper_observers(18, seed=1), 1))
    text = " ".join(own.text for own in report_sections.report_sections(analysis))
    quoted = re.findall(r"(?:^> .*\n)+", (ROOT / "docs" / "tutorial" / "study.md").read_text(), re.MULTILINE)
    assert len(quoted) == 2
    assert [own for own in quoted if " ".join(own.replace("> ", "").split()) not in " ".join(text.split())] == []


def test_the_page_explains_every_note_of_a_fit():
    tree = ast.parse((ROOT / psychometric_fit.__file__).read_text())
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "without_curve":
            found.append(node.args[0])
        if isinstance(node, ast.Yield) or (isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "reason"):
            found.append(node.value)
    texts = [text_of(own) for own in found if not isinstance(own, ast.Name)]
    rows = [row[0] for row in rows_below("A fit that does not converge")]
    assert len(rows) == len(texts) > 9
    assert [row for row in rows if not any(text.startswith(row) for text in texts)] == []


def text_of(node):
    """A text in the source, with examples instead of its values."""
    if isinstance(node, ast.Constant):
        return node.value
    return "".join(
        EXAMPLES[ast.unparse(own.value)] if isinstance(own, ast.FormattedValue) else own.value for own in node.values
    )
