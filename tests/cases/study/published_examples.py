"""Published worked examples of statistics, with the numbers of R 4.2.2 that ours are compared with.

Each example has its data, R's call with the data by their names, and what that call returned, to ten digits.
`docs/measured/study-statistics.md` lists them. Where R would miss ties for rounding, the call has whole numbers.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from palpate.render.study.analysis import hypothesis_tests as ht
from palpate.render.study.analysis.hypothesis_tests import StatisticalTest
from palpate.render.study.analysis.psychometric_fit import fit_psychometric


@dataclass(frozen=True, kw_only=True)
class PublishedExample:
    """Data of others, what R says about them, and the functions of ours that say the same."""

    name: str
    source: str
    """Where it was published; with the number that it prints, where it prints one."""
    data: Mapping[str, tuple[float, ...]]
    r_call: str
    """With the data by their names."""
    numbers: Mapping[str, float]
    """What the call returned."""
    analyse: Callable[..., Mapping[str, float | None]]
    """Ours, by the same names; it takes the data as arrays."""
    tolerance: float = 1e-8
    """Of the difference, as a share: larger where R's numbers come from a search that ends early, or from a spline."""

    def ours(self) -> Mapping[str, float | None]:
        return self.analyse(**{name: np.array(values) for name, values in self.data.items()})


def numbers_of(test: StatisticalTest) -> dict[str, float | None]:
    """The numbers of a test under R's names."""
    return {
        test.statistic: test.value,
        "df": test.freedom,
        "p": test.p,
        "estimate": test.difference,
        "low": test.difference_low,
        "high": test.difference_high,
    }


def fitted(x, k, n, **options):
    """The numbers of a psychometric fit."""
    fit = fit_psychometric(x, k, n, **options)
    return {
        "mu": fit.mu.value,
        "mu low": fit.mu.low,
        "mu high": fit.mu.high,
        "sigma": fit.sigma.value,
        "sigma low": fit.sigma.low,
        "sigma high": fit.sigma.high,
        "lapse": fit.lapse.value,
        "deviance": fit.deviance,
        "p": fit.goodness_p,
    }


def read(text):
    """Numbers between blanks."""
    return tuple(map(float, text.split()))


def of_ten(test):
    """The numbers of a test of proportions of 10 answers, in answers."""
    found = numbers_of(test)
    return found | {name: 10.0 * found[name] for name in ("estimate", "low", "high")}


def corrected(p):
    """The p that Holm's correction makes of p, by their place."""
    tests = [StatisticalTest(test="", compares="", n=1, p=float(own)) for own in p]
    return {f"p{place}": test.p_holm for place, test in enumerate(ht.correct_family(tests), start=1)}


RAIN = read("""
670 547 70 485 140 172 207 130 434 402 389 545 598 483 229 115 344 351 387 308 306 431 568 408 418 425 310 317 302 259
492 370 359 150 302 72 362 455 78 334 361 402 427 425 162 390 350 370 314 376 399 362 428 464 247 491 460 359 78 482
152 325 447 426 388 174 408 291 146 592
""")
ROUNDING = read("""
5.4 5.5 5.55 5.85 5.7 5.75 5.2 5.6 5.5 5.55 5.5 5.4 5.9 5.85 5.7 5.45 5.55 5.6 5.4 5.4 5.35 5.45 5.5 5.35 5.25 5.15 5
5.85 5.8 5.7 5.25 5.2 5.1 5.65 5.55 5.45 5.6 5.35 5.45 5.05 5 4.95 5.5 5.5 5.4 5.45 5.55 5.5 5.55 5.55 5.35 5.45 5.5
5.55 5.5 5.45 5.25 5.65 5.6 5.4 5.7 5.65 5.55 6.3 6.3 6.25
""")
BEETLES = {
    "x": (1.6907, 1.7242, 1.7552, 1.7842, 1.8113, 1.8369, 1.8610, 1.8839),
    "k": (6, 13, 18, 28, 52, 53, 61, 60),
    "n": (59, 60, 62, 56, 63, 59, 62, 60),
}
FIT = """reach <- diff(range(x))
z <- function(v) ((x - min(x)) / reach - v[1]) * v[2]
cost <- function(v, p = MODEL)
  -sum(dbinom(k, n, pmin(pmax(p, 1e-12), 1 - 1e-12), log = TRUE))
search <- function(from, f, own = 1:3) optim(from, f, method = "L-BFGS-B", lower = c(-1, 0.1, 0)[own],
  upper = c(2, 50, MOST)[own], control = list(factr = 1, pgtol = 0, maxit = 1000, ndeps = rep(1e-6, length(own))))
best <- search(c(0.5, 5, MOST / 3), cost)
v <- best$par
lost_mu <- function(m)
  2 * (search(v[2:3], function(u) cost(c(m, u)), 2:3)$value - best$value) - qchisq(0.95, 1)
lost_b <- function(b)
  2 * (search(v[c(1, 3)], function(u) cost(c(u[1], b, u[2])), c(1, 3))$value - best$value) - qchisq(0.95, 1)
end <- function(f, a, b) uniroot(f, c(a, b), tol = 1e-10)$root
c(mu = min(x) + reach * v[1], "mu low" = min(x) + reach * end(lost_mu, -1, v[1]),
  "mu high" = min(x) + reach * end(lost_mu, v[1], 2), sigma = reach / v[2],
  "sigma low" = reach / end(lost_b, v[2], 50), "sigma high" = reach / end(lost_b, 0.1, v[2]), lapse = v[3],
  deviance = 2 * (best$value + sum(dbinom(k, n, k / n, log = TRUE))))"""


TESTS = (
    PublishedExample(
        name="depression scores, Wilcoxon signed-rank",
        source="Hollander & Wolfe 1973, p. 29; example of R's wilcox.test: V = 40, p = 0.019 one-sided",
        data={
            "x": (1.83, 0.5, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.3),
            "y": (0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29),
        },
        r_call="""w <- wilcox.test(x, y, paired = TRUE, conf.int = TRUE)
c(V = w$statistic[[1]], p = w$p.value, estimate = w$estimate[[1]],
  low = w$conf.int[1], high = w$conf.int[2])""",
        numbers={"V": 40.0, "p": 0.0390625, "estimate": 0.46, "low": 0.01, "high": 0.786},
        analyse=lambda x, y: numbers_of(ht.compare_pairs_by_ranks(x, y, "x - y")),
    ),
    PublishedExample(
        name="depression scores, Wilcoxon of one sample",
        source="as above, the first scores alone against 1",
        data={"x": (1.83, 0.5, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.3)},
        r_call="""w <- wilcox.test(x, mu = 1, conf.int = TRUE)
c(V = w$statistic[[1]], p = w$p.value, estimate = w$estimate[[1]] - 1,
  low = w$conf.int[1] - 1, high = w$conf.int[2] - 1)""",
        numbers={"V": 43.0, "p": 0.01171875, "estimate": 0.725, "low": 0.165, "high": 1.37},
        analyse=lambda x: numbers_of(ht.compare_with_centre_by_ranks(x, 1.0, "x - 1")),
    ),
    PublishedExample(
        name="maize, Wilcoxon signed-rank",
        source="Darwin 1876, by Fisher 1935, eighths of an inch",
        data={"d": (49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48)},
        r_call="""w <- wilcox.test(d, conf.int = TRUE)
c(V = w$statistic[[1]], p = w$p.value, estimate = w$estimate[[1]],
  low = w$conf.int[1], high = w$conf.int[2])""",
        numbers={"V": 96.0, "p": 0.04125976563, "estimate": 25.0, "low": 4.0, "high": 41.5},
        analyse=lambda d: numbers_of(ht.compare_with_centre_by_ranks(d, 0.0, "d")),
    ),
    PublishedExample(
        name="maize, one-sample t",
        source="Darwin 1876, by Fisher 1935: t = 2.148",
        data={"d": (49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48)},
        r_call="""t <- t.test(d)
c(t = t$statistic[[1]], df = t$parameter[[1]], p = t$p.value,
  estimate = t$estimate[[1]], low = t$conf.int[1], high = t$conf.int[2])""",
        numbers={
            "t": 2.147987461,
            "df": 14.0,
            "p": 0.04970294402,
            "estimate": 20.93333333,
            "low": 0.03119331839,
            "high": 41.83547335,
        },
        analyse=lambda d: numbers_of(ht.compare_with_centre_by_means(d, 0.0, "d")),
    ),
    PublishedExample(
        name="hours of sleep, paired t",
        source="Student 1908; example of R's t.test: t = -4.0621, p = 0.002833",
        data={
            "x": (0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0),
            "y": (1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4),
        },
        r_call="""t <- t.test(x, y, paired = TRUE)
c(t = t$statistic[[1]], df = t$parameter[[1]], p = t$p.value,
  estimate = t$estimate[[1]], low = t$conf.int[1], high = t$conf.int[2])""",
        numbers={
            "t": -4.062127683,
            "df": 9.0,
            "p": 0.002832890197,
            "estimate": -1.58,
            "low": -2.459885763,
            "high": -0.7001142367,
        },
        analyse=lambda x, y: numbers_of(ht.compare_pairs_by_means(x, y, "x - y")),
    ),
    PublishedExample(
        name="hours of sleep, Wilcoxon with a tie and a zero",
        source="Student 1908; R's p = 0.009091",
        data={
            "x": (0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0),
            "y": (1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4),
        },
        r_call="""w <- wilcox.test(round(10 * x), round(10 * y), paired = TRUE, conf.int = TRUE)
c(V = w$statistic[[1]], p = w$p.value, estimate = w$estimate[[1]],
  low = w$conf.int[1], high = w$conf.int[2])""",
        numbers={"V": 0.0, "p": 0.009090698016, "estimate": -14.00000248, "low": -29.49993915, "high": -10.50000503},
        analyse=lambda x, y: numbers_of(ht.compare_pairs_by_ranks(10.0 * x, 10.0 * y, "x - y")),
        tolerance=1e-4,
    ),
    PublishedExample(
        name="weights of 11 men, Shapiro-Wilk",
        source="Shapiro & Wilk 1965: W = 0.79",
        data={"x": (148, 154, 158, 160, 161, 162, 166, 170, 182, 195, 236)},
        r_call="""s <- shapiro.test(x)
c(W = s$statistic[[1]], p = s$p.value)""",
        numbers={"W": 0.7888146948, "p": 0.006703814057},
        analyse=lambda x: numbers_of(ht.check_normality(x, "x")),
        tolerance=1e-4,
    ),
    PublishedExample(
        name="rounding first base, Friedman",
        source="Hollander & Wolfe 1973, p. 140; example of R's friedman.test: chi2 = 11.143, p = 0.003805",
        data={"x": ROUNDING},
        r_call="""f <- friedman.test(matrix(x, ncol = 3, byrow = TRUE))
c(chi2 = f$statistic[[1]], df = f$parameter[[1]], p = f$p.value)""",
        numbers={"chi2": 11.14285714, "df": 2.0, "p": 0.003805040776},
        analyse=lambda x: numbers_of(ht.compare_levels_by_ranks(x.reshape(-1, 3), "ways")),
    ),
    PublishedExample(
        name="tall plants, exact binomial",
        source="Mendel, by Conover 1971, p. 97; example of R's binom.test: p = 0.3825",
        data={"k": (682,), "n": (925,)},
        r_call="""b <- binom.test(k, n, p = 0.75)
c(p = b$p.value, estimate = b$estimate[[1]] - 0.75, low = b$conf.int[1] - 0.75, high = b$conf.int[2] - 0.75)""",
        numbers={"p": 0.3824915596, "estimate": -0.0127027027, "low": -0.04233173592, "high": 0.01540655824},
        analyse=lambda k, n: numbers_of(ht.compare_with_chance(int(k[0]), int(n[0]), 0.75, "k / n")),
        tolerance=1e-06,
    ),
    PublishedExample(
        name="smokers in four groups, chi-square",
        source="Fleiss 1981, p. 139; example of R's prop.test: chi2 = 12.6, p = 0.005585",
        data={"k": (83, 90, 129, 70), "n": (86, 93, 136, 82)},
        r_call="""h <- suppressWarnings(prop.test(k, n))
c(chi2 = h$statistic[[1]], df = h$parameter[[1]], p = h$p.value)""",
        numbers={"chi2": 12.6004113, "df": 3.0, "p": 0.005585476662},
        analyse=lambda k, n: numbers_of(ht.compare_participants(k, n, "groups")),
    ),
    PublishedExample(
        name="smokers in two of the groups, chi-square",
        source="as above, the last two",
        data={"k": (129, 70), "n": (136, 82)},
        r_call="""h <- suppressWarnings(prop.test(k, n))
c(chi2 = h$statistic[[1]], df = h$parameter[[1]], p = h$p.value)""",
        numbers={"chi2": 4.65617699, "df": 1.0, "p": 0.03094201243},
        analyse=lambda k, n: numbers_of(ht.compare_participants(k, n, "groups")),
    ),
    PublishedExample(
        name="thrombolysis, Holm",
        source="Benjamini & Hochberg 1995: of 15, 3 stay below 0.05",
        data={
            "p": (
                0.0001,
                0.0004,
                0.0019,
                0.0095,
                0.0201,
                0.0278,
                0.0298,
                0.0344,
                0.0459,
                0.324,
                0.4262,
                0.5719,
                0.6528,
                0.759,
                1.0,
            )
        },
        r_call="""h <- p.adjust(p, "holm")
setNames(h[1:9], paste0("p", 1:9))""",
        numbers={
            "p1": 0.0015,
            "p2": 0.0056,
            "p3": 0.0247,
            "p4": 0.114,
            "p5": 0.2211,
            "p6": 0.278,
            "p7": 0.278,
            "p8": 0.278,
            "p9": 0.3213,
        },
        analyse=corrected,
    ),
    PublishedExample(
        name="rain in 70 cities, Wilcoxon, n above 50",
        source="Statistical Abstracts of the United States 1975; R's precip, in tenths of an inch against 350",
        data={"x": RAIN},
        r_call="""w <- wilcox.test(x, mu = 350, conf.int = TRUE)
c(V = w$statistic[[1]], p = w$p.value, estimate = w$estimate[[1]] - 350,
  low = w$conf.int[1] - 350, high = w$conf.int[2] - 350)""",
        numbers={"V": 1286.5, "p": 0.6388146751, "estimate": 9.000076394, "low": -32.5000638, "high": 39.49995502},
        analyse=lambda x: numbers_of(ht.compare_with_centre_by_ranks(x, 350.0, "x - 350")),
        tolerance=1e-4,
    ),
    PublishedExample(
        name="answers of 18 for cc, Wilcoxon with ties and zeros",
        source="a table like those of a study, 10 answers each",
        data={"k": (5, 6, 7, 7, 8, 9, 4, 5, 6, 3, 5, 9, 10, 2, 6, 7, 5, 6)},
        r_call="""w <- wilcox.test(k, mu = 5, conf.int = TRUE)
c(V = w$statistic[[1]], p = w$p.value, estimate = w$estimate[[1]] - 5,
  low = w$conf.int[1] - 5, high = w$conf.int[2] - 5)""",
        numbers={"V": 84.0, "p": 0.04980986562, "estimate": 1.499941444, "low": -4.099621401e-05, "high": 2.999979674},
        analyse=lambda k: of_ten(ht.compare_with_centre_by_ranks(k / 10.0, 0.5, "p_cc - 0.5")),
        tolerance=1e-4,
    ),
    PublishedExample(
        name="answers of 18 in two blocks, Wilcoxon",
        source="a table like those of a study, 10 answers each",
        data={
            "x": (7, 6, 9, 5, 8, 10, 6, 4, 7, 9, 5, 8, 6, 3, 10, 7, 8, 6),
            "y": (5, 6, 7, 6, 6, 9, 6, 5, 4, 7, 5, 6, 7, 3, 8, 4, 8, 5),
        },
        r_call="""w <- wilcox.test(x, y, paired = TRUE, conf.int = TRUE)
c(V = w$statistic[[1]], p = w$p.value, estimate = w$estimate[[1]],
  low = w$conf.int[1], high = w$conf.int[2])""",
        numbers={"V": 82.0, "p": 0.01046645481, "estimate": 1.500018497, "low": 0.4999907535, "high": 2.000024553},
        analyse=lambda x, y: of_ten(ht.compare_pairs_by_ranks(x / 10.0, y / 10.0, "x - y")),
        tolerance=1e-4,
    ),
)
FITS = (
    PublishedExample(
        name="beetles, probit",
        source="Bliss 1935, by Dobson 1990: deviance 10.12",
        data=BEETLES,
        r_call="""g <- glm(cbind(k, n - k) ~ x, binomial("probit"))
b <- coef(g)
mu <- -b[[1]] / b[[2]]
lost <- function(m) deviance(glm(cbind(k, n - k) ~ 0 + I(x - m), binomial("probit"))) - deviance(g) - qchisq(0.95, 1)
ends <- 1 / suppressMessages(confint(g))[2, ]
c(mu = mu, "mu low" = uniroot(lost, c(min(x), mu), tol = 1e-12)$root,
  "mu high" = uniroot(lost, c(mu, max(x)), tol = 1e-12)$root, sigma = 1 / b[[2]], "sigma low" = ends[[2]],
  "sigma high" = ends[[1]], deviance = deviance(g), p = 1 - pchisq(deviance(g), g$df.residual))""",
        numbers={
            "mu": 1.770852395,
            "mu low": 1.763268392,
            "mu high": 1.77817011,
            "sigma": 0.05068953507,
            "sigma low": 0.04397570097,
            "sigma high": 0.05911952762,
            "deviance": 10.11975811,
            "p": 0.1196984996,
        },
        analyse=lambda x, k, n: fitted(x, k, n, lapse_max=0.0),
        tolerance=1e-5,
    ),
    PublishedExample(
        name="two intervals, 6 levels",
        source="demonstration PAL_PFML_Demo of Palamedes (Prins & Kingdom), by a Gaussian",
        data={
            "x": (0.01, 0.03, 0.05, 0.07, 0.09, 0.11),
            "k": (59, 53, 68, 83, 92, 99),
            "n": (100, 100, 100, 100, 100, 100),
        },
        r_call=FIT.replace("MODEL", "0.5 + (0.5 - v[3]) * pnorm(z(v))").replace("MOST", "0.06"),
        numbers={
            "mu": 0.0601829908,
            "mu low": 0.05215410319,
            "mu high": 0.06729269458,
            "sigma": 0.02685810062,
            "sigma low": 0.01813470309,
            "sigma high": 0.03652365212,
            "lapse": 0.0,
            "deviance": 3.327783154,
        },
        analyse=lambda x, k, n: fitted(x, k, n, guess=0.5),
        tolerance=1e-5,
    ),
    PublishedExample(
        name="two intervals, 12 levels",
        source="demonstration of psignifit 4 (Schütt et al. 2016), whose fit gives mu = 0.004654",
        data={
            "x": (0.001, 0.0015, 0.002, 0.0025, 0.003, 0.0035, 0.004, 0.0045, 0.005, 0.006, 0.007, 0.01),
            "k": (45, 50, 44, 44, 52, 53, 62, 64, 76, 79, 88, 90),
            "n": (90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90),
        },
        r_call=FIT.replace("MODEL", "0.5 + (0.5 - v[3]) * pnorm(z(v))").replace("MOST", "0.06"),
        numbers={
            "mu": 0.00465534793,
            "mu low": 0.004358758741,
            "mu high": 0.00495955843,
            "sigma": 0.001469121308,
            "sigma low": 0.001152893709,
            "sigma high": 0.001884697588,
            "lapse": 0.0,
            "deviance": 5.023947444,
        },
        analyse=lambda x, k, n: fitted(x, k, n, guess=0.5),
        tolerance=1e-5,
    ),
    PublishedExample(
        name="two intervals, 6 levels, some lapses",
        source="tutorial of psignifit 3 (Fründ et al. 2011), by a Gaussian",
        data={"x": (0, 2, 4, 6, 8, 10), "k": (34, 32, 40, 48, 50, 48), "n": (50, 50, 50, 50, 50, 50)},
        r_call=FIT.replace("MODEL", "0.5 + (0.5 - v[3]) * pnorm(z(v))").replace("MOST", "0.06"),
        numbers={
            "mu": 2.671019783,
            "mu low": 1.280900218,
            "mu high": 3.836716202,
            "sigma": 2.438800105,
            "sigma low": 1.145211144,
            "sigma high": 4.68564797,
            "lapse": 0.01860556361,
            "deviance": 7.705438969,
        },
        analyse=lambda x, k, n: fitted(x, k, n, guess=0.5),
        tolerance=1e-5,
    ),
    PublishedExample(
        name="comparisons, lapses on both sides",
        source="a table like those of a study, 10 answers each",
        data={"x": (1, 2, 3, 4, 5, 6, 7), "k": (1, 0, 3, 5, 8, 10, 9), "n": (10, 10, 10, 10, 10, 10, 10)},
        r_call=FIT.replace("MODEL", "v[3] + (1 - 2 * v[3]) * pnorm(z(v))").replace("MOST", "0.06"),
        numbers={
            "mu": 3.891971938,
            "mu low": 3.322304719,
            "mu high": 4.457523431,
            "sigma": 0.9570192316,
            "sigma low": 0.5162381546,
            "sigma high": 2.056639035,
            "lapse": 0.05705523721,
            "deviance": 4.16775718,
        },
        analyse=lambda x, k, n: fitted(x, k, n, ties_lapse_to_guess=True),
        tolerance=1e-5,
    ),
    PublishedExample(
        name="falling proportions",
        source="Bliss 1935, beetles that survive",
        data={
            "x": (1.6907, 1.7242, 1.7552, 1.7842, 1.8113, 1.8369, 1.861, 1.8839),
            "k": (53, 47, 44, 28, 11, 6, 1, 0),
            "n": (59, 60, 62, 56, 63, 59, 62, 60),
        },
        r_call=FIT.replace("MODEL", "(1 - v[3]) * pnorm(-z(v))").replace("MOST", "0.06"),
        numbers={
            "mu": 1.778962904,
            "mu low": 1.769669431,
            "mu high": 1.786619877,
            "sigma": 0.04316083499,
            "sigma low": 0.03580257823,
            "sigma high": 0.05248949469,
            "lapse": 0.06,
            "deviance": 5.700255293,
        },
        analyse=lambda x, k, n: fitted(x, k, n),
        tolerance=1e-5,
    ),
)
EXAMPLES = TESTS + FITS


def table_of_examples(examples: tuple[PublishedExample, ...]) -> str:
    """Examples as a Markdown table, with numbers to six digits."""
    lines = ["| example | published | R 4.2.2 | palpate |", "|---|---|---|---|"]
    for example in examples:
        found = example.ours()
        # What R's search for a root leaves of zero is shown as zero.
        of_r = {name: 0.0 if abs(own) < example.tolerance else own for name, own in example.numbers.items()}
        cells = [", ".join(f"{name} {numbers[name]:.6g}" for name in of_r) for numbers in (of_r, found)]
        lines.append(f"| {example.name} | {example.source} | {' | '.join(cells)} |")
    return "\n".join(lines)
