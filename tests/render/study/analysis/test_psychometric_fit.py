"""Psychometric fits: against published data with R's numbers, a grid of all curves, and observers that are known."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from published_examples import FITS, table_of_examples
from scipy import special, stats

from palpate.render.errors import StudyError
from palpate.render.study.analysis.psychometric_fit import FittedValue, fit_psychometric

pytestmark = pytest.mark.exhaustive

PAGE = Path(__file__).parents[4] / "docs/measured/study-statistics.md"
LEVELS = np.arange(1.0, 8.0)
FEW = settings(max_examples=6, deadline=None)
MODELS = {
    "yes or no": {},
    "two intervals": {"guess": 0.5},
    "comparison": {"ties_lapse_to_guess": True},
}


def share(x, mu, sigma, lapse=0.0, *, guess=0.0, ties_lapse_to_guess=False):
    """The curve as the docstring of `fit_psychometric` writes it; sigma below 0: it falls."""
    low = lapse if ties_lapse_to_guess else guess
    return low + (1.0 - low - lapse) * stats.norm.cdf((x - mu) / sigma)


def log_likelihood(successes, counts, p):
    """Of proportions p, without binomial coefficients."""
    return (special.xlogy(successes, p) + special.xlogy(counts - successes, 1.0 - p)).sum(axis=-1)


def grid_of_curves(mu=None, sigma=None, *, fineness=1):
    """mu, sigma and lapse of many curves, each of shape [curve, 1]; with one mu or one sigma if it is given."""
    mu = np.linspace(-1.0, 9.0, 50 * fineness + 1) if mu is None else np.array([mu])
    sigma = np.geomspace(0.03, 30.0, 30 * fineness + 1) if sigma is None else np.array([sigma])
    return [own.reshape(-1, 1) for own in np.meshgrid(mu, sigma, np.linspace(0.0, 0.06, 3 * fineness + 1))]


@pytest.mark.parametrize("example", FITS, ids=lambda own: own.name)
def test_published_data_have_the_numbers_of_r(example):
    found = example.ours()
    for name, number in example.numbers.items():
        assert found[name] == pytest.approx(number, rel=example.tolerance, abs=1e-9), name


def test_the_page_of_measured_statistics_lists_these_fits():
    assert table_of_examples(FITS) in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("sigma", [1.2, -0.8])
def test_answers_that_lie_on_a_curve_give_that_curve(model, sigma):
    options = MODELS[model]
    counts = np.full(7, 10_000_000)
    found = fit_psychometric(LEVELS, np.round(counts * share(LEVELS, 3.7, sigma, 0.03, **options)), counts, **options)
    assert found.mu.value == pytest.approx(3.7, abs=0.002)
    assert found.sigma.value == pytest.approx(abs(sigma), abs=0.002)
    assert found.lapse.value == pytest.approx(0.03, abs=0.001)
    assert found.is_increasing == (sigma > 0)
    assert found.jnd.value == pytest.approx(stats.norm.ppf(0.75) * found.sigma.value)
    assert found.predict(LEVELS) == pytest.approx(share(LEVELS, 3.7, sigma, 0.03, **options), abs=1e-4)
    assert (found.converged, found.note, found.freedom) == (True, "", 4)


@pytest.mark.parametrize("model", MODELS)
@given(successes=st.lists(st.integers(0, 8), min_size=7, max_size=7))
@example(successes=[1, 1, 6, 7, 8, 5, 4])  # a lower maximum lies nearer to the best start
@FEW
def test_no_curve_of_a_grid_describes_any_answers_better(model, successes):
    options = MODELS[model]
    successes, counts = np.array(successes), np.full(7, 8)
    found = fit_psychometric(LEVELS, successes, counts, with_intervals=False, **options)
    mu, sigma, lapse = grid_of_curves()
    rising = log_likelihood(successes, counts, share(LEVELS, mu, sigma, lapse, **options))
    falling = log_likelihood(successes, counts, share(LEVELS, mu, -sigma, lapse, **options))
    best = max(rising.max(), falling.max())
    saturated = log_likelihood(successes, counts, successes / counts)
    if found.deviance is None:
        # Then a flat line is as good as any curve, but for curves that are all but flat.
        assert found.note
        pooled = max(successes.sum() / counts.sum(), options.get("guess", 0.0))
        assert best <= log_likelihood(successes, counts, pooled) + 1e-4
    else:
        assert found.deviance <= 2.0 * (saturated - best) + 1e-9


@pytest.mark.parametrize("model", MODELS)
def test_intervals_end_where_the_best_of_a_grid_of_curves_has_the_deviance_of_the_quantile(model):
    options = MODELS[model]
    counts = np.full(7, 40)
    successes = np.round(counts * share(LEVELS, 4.2, 1.1, 0.02, **options))
    found = fit_psychometric(LEVELS, successes, counts, **options)
    saturated = log_likelihood(successes, counts, successes / counts)
    for name, value in (("mu", found.mu), ("sigma", found.sigma)):
        for end in (value.low, value.high):
            curves = grid_of_curves(**{name: end}, fineness=4)
            lost = 2.0 * (saturated - log_likelihood(successes, counts, share(LEVELS, *curves, **options)).max())
            # The grid's best curve is a little worse than the best one with this value, never better.
            assert -1e-3 < lost - found.deviance - stats.chi2.ppf(0.95, 1) < 0.1


# Data that cannot say ------------------------------------------------------------------------------------------------

NO_CURVE = {
    "no answers": ([], [], "There are no answers."),
    "none": ([1, 2], [0, 0], "All answers are of one kind, so there is no threshold (0 of 10 at 1, 0 of 10 at 2)."),
    "all": ([1, 2], [10, 10], "All answers are of one kind, so there is no threshold (10 of 10 at 1, 10 of 10 at 2)."),
    "one level": ([3, 3], [4, 1], "A curve needs 2 levels, and there is one (5 of 20 at 3)."),
    "flat": ([1, 2, 3], [5, 5, 5], "No curve describes the data better than a flat line (5 of 10 at 1, "),
}


@pytest.mark.parametrize("case", NO_CURVE)
def test_data_without_a_curve_give_no_value_and_a_sentence_with_the_data(case):
    x, successes, note = NO_CURVE[case]
    found = fit_psychometric(x, successes, [10] * len(x))
    assert found.note.startswith(note)
    assert (found.mu, found.sigma, found.lapse, found.jnd) == (FittedValue(),) * 4
    assert (found.converged, found.is_increasing, found.deviance, found.goodness_p) == (False, None, None, None)
    assert np.isnan(found.predict(np.array([1.0, 2.0]))).all()


@pytest.mark.parametrize("is_turned", [False, True])
def test_a_step_between_two_levels_has_its_middle_as_threshold_and_an_upper_end_of_sigma(is_turned):
    successes = [0, 0, 0, 10, 10, 10]
    found = fit_psychometric(range(6), successes[::-1] if is_turned else successes, [10] * 6)
    assert found.mu.value == pytest.approx(2.5)
    assert 2.0 < found.mu.low < 2.5 < found.mu.high < 3.0
    assert (found.sigma.value, found.sigma.low) == (0.0, 0.0)
    assert 0.2 < found.sigma.high < 1.0
    assert not found.converged
    assert "A step, at a level or between two, describes the answers as well as any curve" in found.note
    assert "0 of 10 at 2, 10 of 10 at 3" in found.note or is_turned
    assert found.predict(np.array([2.0, 2.5, 3.0])) == pytest.approx([1.0, 0.5, 0.0] if is_turned else [0.0, 0.5, 1.0])


def test_a_step_at_a_level_among_others_of_many_sizes_is_seen():
    # Far from the step all curves that are as steep are equally bad: a search that begins there stays there.
    found = fit_psychometric(range(8), [0, 0, 0, 0, 2, 8, 8, 10], [11, 1, 11, 4, 8, 8, 8, 10])
    assert (found.sigma.value, found.sigma.low) == (0.0, 0.0)
    assert found.mu.low < 4.0 < found.mu.high


def test_a_weak_slope_leaves_intervals_open_and_says_so():
    found = fit_psychometric([1.0, 2.0, 3.0, 4.0, 5.0], [5, 4, 6, 5, 7], [10] * 5)
    assert found.converged
    assert (found.sigma.high, found.mu.low) == (None, None)
    assert found.sigma.low > 0.0
    assert "Sigma has no upper bound: a flat line is not refused either" in found.note
    assert "The threshold has no lower" in found.note
    assert found.note.endswith("(5 of 10 at 1, 4 of 10 at 2, 6 of 10 at 3, 5 of 10 at 4, 7 of 10 at 5).")


REFUSED = {
    "guess": ({"guess": 1.0}, "guess must lie in 0..1, below 1, not 1.0"),
    "guess and tie": ({"guess": 0.5, "ties_lapse_to_guess": True}, "guess must be 0 where"),
    "lapse": ({"lapse_max": 0.5}, "lapse_max must lie in 0..0.5, below 0.5, not 0.5"),
    "lapse above guesses": ({"guess": 0.75, "lapse_max": 0.3}, "lapse_max must lie in 0..0.25"),
    "shapes": ({"x": [1.0]}, "x, successes and counts must have one value for each level"),
    "x": ({"x": [1.0, np.nan]}, "x must be finite, not nan"),
    "more than asked": ({"successes": [1, 11]}, "whole numbers in 0..count, not 11 of 10 at x = 2"),
    "part of an answer": ({"successes": [1, 2.5]}, "whole numbers in 0..count, not 2.5 of 10 at x = 2"),
    "nan": ({"successes": [1, np.nan]}, "whole numbers in 0..count, not nan of 10"),
    "endless": ({"counts": [10, np.inf]}, "whole numbers in 0..count, not 2 of inf"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_malformed_is_refused_with_its_value_and_bound(case):
    options, message = REFUSED[case]
    with pytest.raises(StudyError, match=message):
        fit_psychometric(**{"x": [1.0, 2.0], "successes": [1, 2], "counts": [10, 10], **options})


# Rates, and another program ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "model"), [(3, "yes or no"), *((1000, model) for model in MODELS)])
def test_intervals_hold_what_was_planted_at_the_rate_that_they_claim(count, model):
    random = np.random.default_rng(2026)
    options = MODELS[model]
    counts = np.full(7, 40)
    truth = {"mu": 3.8, "sigma": 1.3}
    held = dict.fromkeys(truth, 0)
    refused = 0
    for _ in range(count):
        successes = random.binomial(counts, share(LEVELS, *truth.values(), 0.02, **options))
        found = fit_psychometric(LEVELS, successes, counts, **options)
        for name, value in truth.items():
            own = getattr(found, name)
            held[name] += (own.low is None or own.low <= value) and (own.high is None or value <= own.high)
        refused += found.goodness_p < 0.05
    for number in held.values():
        low, high = stats.binomtest(number, count).proportion_ci(0.99)
        assert low <= 0.95 <= high
    # Chi-square is an approximation for a deviance, and a lapse rate at its bound is not counted as fitted.
    low, high = stats.binomtest(refused, count).proportion_ci(0.99)
    assert low <= 0.07
    assert high >= 0.03


def test_psignifit_finds_the_same_curve():
    psignifit = pytest.importorskip("psignifit", reason="GPL: an oracle where somebody has installed it")
    x, k, n = (np.array(own, dtype=float) for own in FITS[2].data.values())
    expected = psignifit.psignifit(np.stack([x, k, n], axis=1), sigmoid="norm", experiment_type="2AFC")
    estimate = expected.parameter_estimate_MAP
    found = fit_psychometric(x, k, n, guess=0.5)
    # Its priors move the estimates a little; its width is that from 5 % to 95 %.
    assert found.mu.value == pytest.approx(estimate["threshold"], rel=0.002)
    assert 2.0 * stats.norm.ppf(0.95) * found.sigma.value == pytest.approx(estimate["width"], rel=0.005)
    assert found.lapse.value == pytest.approx(estimate["lambda"], abs=0.001)
