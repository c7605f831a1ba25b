"""Sentences and cells of tables, read aloud: each is compared as a whole."""

from dataclasses import replace

import pytest

from palpate.render.study.analysis.hypothesis_tests import StatisticalTest
from palpate.render.study.analysis.report_sections import (
    chance_sentence,
    number_text,
    p_equation,
    pair_sentences,
)

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
