"""Sentences and cells of tables, read aloud: each is compared as a whole."""

from dataclasses import replace

import numpy as np
import pytest
from answered_tables import PAPER, paper_answers, plan_of, table_of

from palpate.render.study.analysis.answer_measures import choice_measures
from palpate.render.study.analysis.measure_tests import analyse_measure
from palpate.render.study.analysis.measures import Cell, Measure
from palpate.render.study.analysis.result_texts import (
    LEVEL_HEAD,
    TEST_HEAD,
    all_tests,
    chance_sentence,
    is_found,
    level_rows,
    mean_text,
    number_text,
    p_equation,
    pair_sentences,
    statistic_text,
)
from palpate.render.study.analysis.result_texts import (
    test_row as row_of,  # pytest would take it for a test
)
from palpate.render.study.analysis.result_texts import (
    test_text as bracket_text,
)
from palpate.render.study.analysis.statistical_test import StatisticalTest

RANKS = StatisticalTest(
    test="Wilcoxon signed-rank test", compares="cube - tube", n=18, statistic="V", value=148.0, p=0.0061, p_holm=0.0183,
    effect="rank-biserial r", effect_size=0.73, difference=0.15, difference_low=0.05, difference_high=0.25,
    note="2 differences tied in size; normal approximation with continuity correction",
)  # fmt: skip
APART = ", difference 0.15 [0.05, 0.25]"
LOWER = replace(RANKS, compares="dog - cube", value=20.0, effect_size=-0.7, p_holm=0.0004)
NOT_FOUND = replace(RANKS, compares="tube - dog", value=70.0, p=0.2, p_holm=0.2, effect_size=0.1)
NO_TEST = StatisticalTest(
    test="Wilcoxon signed-rank test", compares="cube - dog", n=3, note="no test: all differences are zero"
)
T = StatisticalTest(
    test="paired t-test", compares="cube - tube", n=10, statistic="t", value=-4.0621, freedom=9, p=0.002833,
    effect="Cohen's d_z", effect_size=-1.2846,
)  # fmt: skip


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, ""), (float("nan"), ""), (0.0, "0"), (-0.0, "0"), (2 / 3, "0.667"), (-4.0621, "-4.06"), (100.0, "100"),
        (999.4, "999"), (999.6, "1000"), (1234.0, "1234"), (-4157.5, "-4158"), (12345678.0, "1.23e+07"),
        (0.000012345, "1.23e-05"),
    ],
)  # fmt: skip
def test_numbers_have_three_digits_and_large_ones_no_power_of_ten(value, text):
    assert number_text(value) == text


@pytest.mark.parametrize(
    ("p", "text"),
    [
         (0.0, "p < 0.001"), (0.00099, "p < 0.001"), (0.001, "p = 0.001"), (0.0123, "p = 0.012"),
        (0.0494, "p = 0.049"), (0.0496, "p = 0.0496"), (0.04999, "p = 0.04999"), (0.05, "p = 0.050"),
        (0.0503, "p = 0.050"), (1.0, "p = 1.000"),
    ],
)  # fmt: skip
def test_a_p_that_is_significant_is_not_rounded_to_the_bound(p, text):
    assert p_equation(p) == text


def test_statistics_show_their_degrees_of_freedom():
    assert statistic_text(T) == "t(9) = -4.06"
    assert statistic_text(RANKS) == "V = 148"
    assert statistic_text(NO_TEST) == ""


def test_what_stands_in_brackets_is_the_corrected_p_where_there_is_one():
    assert bracket_text(RANKS) == "Wilcoxon signed-rank test, V = 148, n = 18, p_Holm = 0.018, r_rb = 0.73" + APART
    assert bracket_text(T) == "paired t-test, t(9) = -4.06, n = 10, p = 0.003, d_z = -1.28"
    assert bracket_text(NO_TEST) == "Wilcoxon signed-rank test: all differences are zero"
    shapiro = StatisticalTest(test="Shapiro-Wilk test", compares="p_cc", n=108, statistic="W", value=0.9, p=0.0001)
    assert bracket_text(shapiro) == "Shapiro-Wilk test, W = 0.9, n = 108, p < 0.001"


def test_a_row_of_a_table_has_both_p_and_the_interval():
    assert dict(zip(TEST_HEAD, row_of(RANKS), strict=True)) == {
        "comparison": "cube - tube", "test": "Wilcoxon signed-rank test", "n": "18", "statistic": "V = 148",
        "p": "0.006", "p (Holm)": "0.018", "effect size": "r_rb = 0.73",
        "difference (95 %)": "0.15 (0.05 to 0.25)",
        "note": "2 differences tied in size; normal approximation with continuity correction",
    }  # fmt: skip
    assert row_of(NO_TEST)[3:8] == ("", "-", "", "", "")
    assert row_of(replace(RANKS, difference_low=None))[7] == "0.15"


@pytest.mark.parametrize(
    ("test", "sentence"),
    [
        (
            replace(RANKS, p_holm=None),
            f"p_cc is above chance (0.5; Wilcoxon signed-rank test, V = 148, n = 18, p = 0.006, r_rb = 0.73{APART}).",
        ),
        (
            replace(RANKS, p_holm=None, effect_size=-0.73),
            f"p_cc is below chance (0.5; Wilcoxon signed-rank test, V = 148, n = 18, p = 0.006, r_rb = -0.73{APART}).",
        ),
        (
            replace(RANKS, p_holm=None, p=0.05),
            "No difference of p_cc from chance (0.5) was found "
            f"(Wilcoxon signed-rank test, V = 148, n = 18, p = 0.050, r_rb = 0.73{APART}).",
        ),
        (
            NO_TEST,
            "Whether p_cc differs from chance (0.5) cannot be tested "
            "(Wilcoxon signed-rank test: all differences are zero).",
        ),
    ],
)
def test_a_sentence_says_on_which_side_of_chance_a_measure_is(test, sentence):
    assert chance_sentence("p_cc", test, 0.5) == sentence


HIGHER_TEXT = f"confidence is higher for cube than for tube (V = 148, n = 18, p_Holm = 0.018, r_rb = 0.73{APART})."
LOWER_TEXT = f"Confidence is lower for dog than for cube (V = 20, n = 18, p_Holm < 0.001, r_rb = -0.70{APART})."
NOT_FOUND_TEXT = "tube and dog: V = 70, n = 18, p_Holm = 0.200, r_rb = 0.10" + APART
NO_TEST_TEXT = "cube and dog: all differences are zero"
HOLM = "By Holm-corrected Wilcoxon signed-rank tests,"
ALONE = replace(RANKS, compares="1 - 0.7", p_holm=None)


@pytest.mark.parametrize(
    ("tests", "text"),
    [
        ([RANKS, LOWER], f"{HOLM} {HIGHER_TEXT} {LOWER_TEXT}"),
        ([NOT_FOUND, RANKS], f"{HOLM} {HIGHER_TEXT} No other difference was found ({NOT_FOUND_TEXT})."),
        ([NOT_FOUND, NO_TEST], f"{HOLM} no difference was found ({NOT_FOUND_TEXT}; {NO_TEST_TEXT})."),
        ([NOT_FOUND] * 7, f"{HOLM} no difference was found (in 7 pairs, least p_Holm = 0.200)."),
        ([NO_TEST] * 7, "By Wilcoxon signed-rank test, no difference was found (in 7 pairs)."),
        (
            [ALONE],
            "By Wilcoxon signed-rank test, confidence is higher for 1 than for 0.7 (V = 148, n = 18, p = 0.006, "
            f"r_rb = 0.73{APART}).",
        ),
        ([], ""),
    ],
)
def test_sentences_say_which_levels_differ_and_which_were_not_found_to(tests, text):
    assert pair_sentences("confidence", tests) == text


def test_a_level_with_the_sign_of_the_difference_in_its_name_is_not_cut():
    own = replace(RANKS, compares="cube - big - tube")
    text = "V = 148, n = 18, p_Holm = 0.018, r_rb = 0.73" + APART
    assert pair_sentences("p_cc", [own]) == f"{HOLM} p_cc has a difference cube - big - tube above 0 ({text})."
    none = pair_sentences("p_cc", [replace(own, p_holm=0.3)])
    assert none.startswith(f"{HOLM} no difference was found (cube - big - tube: V = ")
    assert "p_cc is higher for 1 than for -2 (" in pair_sentences("p_cc", [replace(RANKS, compares="1 - -2")])


@pytest.mark.parametrize(
    ("name", "begin"), [("jnd", "jnd is"), ("r", "r is"), ("point of", "Point of is"), ("ease", "Ease is")]
)
def test_words_begin_sentences_with_a_capital_letter_and_symbols_stay(name, begin):
    assert chance_sentence(name, RANKS, 0.0).startswith(begin)


@pytest.mark.parametrize(
    ("p", "p_holm", "found"), [(0.01, None, True), (0.01, 0.06, False), (None, None, False), (0.05, None, False)]
)
def test_found_is_what_the_correction_leaves(p, p_holm, found):
    assert is_found(replace(RANKS, p=p, p_holm=p_holm)) is found


def measure(values, cells):
    values = np.array(values, dtype=float)
    return Measure(name="m", title="m", codes=tuple("abcd"[: len(values)]), cells=tuple(cells), values=values)


def test_descriptive_rows_are_of_participants_means():
    cells = [
        Cell(f"{one}{other}", {"object": one, "opacity": other}) for one in ("cube", "tube") for other in (1.0, 0.7)
    ]
    rows = level_rows(measure([[1, 3, 5, 7], [3, 5, 7, np.nan]], cells))
    assert len(rows[0]) == len(LEVEL_HEAD)
    assert rows == [
        ("object", "cube", "2", "3", "1.41", "3", "2", "4"),  # means 2 and 4
        ("object", "tube", "1", "6", "", "6", "6", "6"),  # the second participant lacks a cell
        ("opacity", "1", "2", "4", "1.41", "4", "3", "5"),
        ("opacity", "0.7", "1", "5", "", "5", "5", "5"),
        ("cell", "cube, 1", "2", "2", "1.41", "2", "1", "3"),
        ("cell", "cube, 0.7", "2", "4", "1.41", "4", "3", "5"),
        ("cell", "tube, 1", "2", "6", "1.41", "6", "5", "7"),
        ("cell", "tube, 0.7", "1", "7", "", "7", "7", "7"),
        ("all", "", "1", "4", "", "4", "4", "4"),
    ]


def test_cells_that_are_the_levels_of_the_only_factor_are_listed_once():
    rows = level_rows(measure([[1, 2]], [Cell("x", {"block": "x"}), Cell("y", {"block": "y"})]))
    assert [own[:2] for own in rows] == [("block", "x"), ("block", "y"), ("all", "")]
    rows = level_rows(measure([[np.nan]], [Cell("x", {"block": "x"})]))
    assert rows == [("cell", "x", "0", "", "", "", "", ""), ("all", "", "0", "", "", "", "", "")]


@pytest.mark.parametrize(
    ("values", "text"), [([], "nothing"), ([np.nan], "nothing"), ([2.0, np.nan], "2 (n = 1)"), ([1.0, 3.0], "2 ± 1.41")]
)
def test_means_are_of_what_is_there(values, text):
    assert mean_text(np.array(values)) == text


def test_every_test_of_a_measure_is_listed_once():
    rows = ["1101111011 5 3", "0111101110 4 4", "1100010110 3 5", "1110111011 5 2", "0001110100 2 6", "1101011010 4 4"]
    table = table_of(plan_of(PAPER), paper_answers("P01", rows), paper_answers("P02", rows[::-1]))
    listed = list(all_tests(analyse_measure(choice_measures(table)[0])))
    kinds = [(factor, kind) for factor, kind, _ in listed]
    assert kinds.count(("object", "participants")) == 7  # Friedman, and 3 pairs by ranks and by means
    assert kinds.count(("object", "cells")) == 3
    assert kinds.count(("opacity", "participants")) == 2  # two levels: no Friedman
    assert kinds.count(("opacity", "cells")) == 1
    assert kinds.count(("", "cells")) == 2  # Shapiro, chance
    assert kinds.count(("", "participants")) == 2
    assert kinds.count(("", "answers")) == 3  # homogeneity, and one of each participant
    assert len({id(test) for *_, test in listed}) == len(listed) == 20
