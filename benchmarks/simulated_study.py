"""The founding paper's study by simulated people: what is planted in them, and what the analysis recovers.

    python benchmarks/simulated_study.py [--studies 10] [--tables 2000] [--page docs/measured/simulated-study.md]

Whole studies go through the participant's page's own protocol, on a virtual clock, into a real data file. Tables are
made by the same observers without the protocol, and given to the analysis alone: how often it finds what is planted,
what its power says, and how often it finds what is not there.
"""

import argparse
import json
import math
import multiprocessing
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import NormalDist

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "oracles"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "cases" / "study"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "cases" / "pages"))
from simulated_participants import ObservedTables, simulate_study
from study_observers import PAPER_RATIOS, Observer, null_observers, paper_observers

from palpate.render.study.analysis.answer_measures import choice_measures
from palpate.render.study.analysis.answer_reading import read_answers
from palpate.render.study.analysis.hypothesis_tests import bound_proportion, compare_with_centre_by_ranks
from palpate.render.study.analysis.measure_tests import compare_pairs
from palpate.render.study.analysis.power import power_of, power_question
from palpate.render.study.analysis.report_sections import is_found
from palpate.render.study.analysis.study_analysis import StudyAnalysis, analyse_answers
from palpate.render.study.plan.study_plan import StudyPlan, example_text
from palpate.render.study.plan.study_reading import read_stored_study

OBJECTS = ("cube", "tube", "dog")
OPACITIES = (1.0, 0.7)
WEAK = {"cube-cc": 0.3, "tube-cc": 0.3, "dog-cc": 0.0, "cube-oc": 0.0, "tube-oc": 0.0, "dog-oc": 0.0}
"""Strengths that 18 participants find sometimes, so that a rate says something about power."""
PEOPLE: dict[str, Callable[[int], list[Observer]]] = {
    "as in the paper": lambda seed: paper_observers(18, seed=seed),
    "weak effect, one group": lambda seed: paper_observers(
        18, seed=seed, opposite=0, indifferent=0, strengths=WEAK, opacity_effect=0.0
    ),
    "nothing is felt": lambda seed: null_observers(18, seed=seed),
    "two groups": lambda seed: paper_observers(
        18, seed=seed, opposite=int(np.random.default_rng(seed).binomial(18, 0.5)), indifferent=0, opacity_effect=0.0
    ),
}
"""Participants of one study, by what is planted."""
NORMAL = NormalDist()
MEMORY = "/dev/shm"
"""Folder of data files, where it exists: a study waits for the disk 3000 times."""
POWER_FACTOR = 3
"""Tables that judge the power, for each of the others: powers differ by little."""
Findings = dict[str, bool]


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulate, print figures as JSON, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=10, help="whole studies through the page's protocol")
    parser.add_argument("--tables", type=int, default=2000, help="of each kind of people, given to the analysis alone")
    parser.add_argument("--workers", type=int, default=2, help="processes that make tables")
    parser.add_argument("--page", type=Path, help="Markdown file to write")
    options = parser.parse_args(arguments)
    begun = time.perf_counter()
    studies = whole_studies(options.studies)
    rates = {name: table_rates(name, options.tables, options.workers) for name in PEOPLE}
    powers = compare_power(POWER_FACTOR * options.tables)
    figures = {"studies": studies, "rates": rates, "powers": powers, "seconds": time.perf_counter() - begun}
    sys.stdout.write(json.dumps(figures, indent=1) + "\n")
    if options.page:
        options.page.write_text(page_text(figures, options.tables))
    return 0


def paper_plan() -> StudyPlan:
    """The example plan of the paper's study."""
    return read_stored_study(example_text("paper"), "paper.toml")


def whole_studies(count: int) -> list[dict]:
    """Planted and recovered numbers of studies that ran through the page's protocol."""
    plan, found = paper_plan(), []
    for seed in range(1, count + 1):
        people = PEOPLE["as in the paper"](seed)
        with tempfile.TemporaryDirectory(dir=MEMORY if Path(MEMORY).is_dir() else None) as folder:
            begun = time.perf_counter()
            analysis = analyse_answers(read_answers(simulate_study(plan, people, Path(folder), seed=seed)))
            seconds = time.perf_counter() - begun
        found.append(
            {
                "seed": seed, "answers": len(analysis.table.answers), "seconds": round(seconds, 1),
                "planted": planted(people), "recovered": recovered(analysis), "found": findings(analysis),
            }
        )  # fmt: skip
    return found


def planted(people: Sequence[Observer]) -> dict[str, float]:
    """The numbers that these people would give with endless trials: of p_cc from the normal distribution."""
    values = {
        (shape, opacity): statistics.fmean(closed_share(own, shape, opacity) for own in people)
        for shape in OBJECTS
        for opacity in OPACITIES
    }
    numbers = {"p_cc": statistics.fmean(values.values())}
    numbers |= {f"p_cc {shape}": statistics.fmean(values[shape, own] for own in OPACITIES) for shape in OBJECTS}
    numbers |= {f"p_cc {own:g}": statistics.fmean(values[shape, own] for shape in OBJECTS) for own in OPACITIES}
    numbers |= {f"r {shape}": PAPER_RATIOS[shape, 1.0][0] for shape in OBJECTS}
    for kind, sign in (("for", 1), ("against", -1), ("ambiguous", 0)):
        numbers[f"people {kind}"] = sum(own.sign == sign for own in people)
    return numbers


def closed_share(own: Observer, shape: str, opacity: float) -> float:
    """How often an observer calls closed contours denser: two feelings with a deviation of 1 each, and lapses."""
    seen = 0.5 if opacity >= 1.0 else -0.5
    strength = own.strengths[f"{shape}-cc"] - own.strengths[f"{shape}-oc"]
    distance = own.sensitivity * strength * (own.sign + own.opacity_effect * seen) * (own.sign != 0)
    return own.lapse / 2 + (1 - own.lapse) * NORMAL.cdf(distance / math.sqrt(2))


def recovered(analysis: StudyAnalysis) -> dict[str, float]:
    """The same numbers as the analysis has them."""
    (choice,), (ratio,) = analysis.choices, analysis.ratios
    p, r = choice.measure, ratio.measure
    numbers = {"p_cc": float(p.values.mean())}
    numbers |= {f"p_cc {shape}": float(p.at_level("object", shape).mean()) for shape in OBJECTS}
    numbers |= {f"p_cc {own:g}": float(p.at_level("opacity", own).mean()) for own in OPACITIES}
    numbers |= {f"r {shape}": float(r.at_level("object", shape).mean()) for shape in OBJECTS}
    tendencies = Counter(own.tendency for own in choice.tendencies)
    numbers |= {f"people {kind}": tendencies[kind] for kind in ("for", "against")}
    return numbers | {"people ambiguous": tendencies["ambiguous"]}


def findings(analysis: StudyAnalysis) -> Findings:
    """What each test of interest finds, by a name: of p_cc against chance, and of pairs of levels of each measure."""
    (choice,) = analysis.choices
    assert choice.chance_by_ranks is not None
    assert choice.chance_by_means is not None
    assert choice.chance_by_cells is not None
    assert choice.heterogeneity is not None
    found = {
        "p_cc against chance, participants": is_found(choice.chance_by_ranks),
        "p_cc against chance, t-test": is_found(choice.chance_by_means),
        "p_cc against chance, cells as observations": is_found(choice.chance_by_cells),
        "participants differ": is_found(choice.heterogeneity),
    }
    for tests in (*analysis.choices, *analysis.scales):
        for own in tests.factors:
            name = f"{tests.measure.name} by {own.factor}"
            found[f"{name}, any pair"] = any(map(is_found, own.by_ranks))
            found[f"{name}, any pair by t-tests"] = any(map(is_found, own.by_means))
            if own.omnibus is not None:
                found[f"{name}, Friedman"] = is_found(own.omnibus)
            if tests.measure.name == "p_cc" and len(own.levels) > 2:
                found |= {f"p_cc: {test.compares}": is_found(test) for test in own.by_ranks}
    return found


def table_rates(name: str, count: int, workers: int) -> dict[str, int | dict[str, int]]:
    """How many of `count` tables each test finds something in."""
    shares = [range(number, count, workers) for number in range(workers)]
    if workers == 1:
        counters: Iterable[Counter[str]] = [_count_findings((name, own)) for own in shares]
    else:
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            counters = pool.map(_count_findings, [(name, own) for own in shares])
    total: Counter[str] = Counter()
    for own in counters:
        total.update(own)
    return {"tables": count, "found": dict(total)}


def _count_findings(task: tuple[str, range]) -> Counter[str]:
    name, seeds = task
    tables = ObservedTables(paper_plan())
    total: Counter[str] = Counter()
    for seed in seeds:
        found = findings(analyse_answers(tables.table(PEOPLE[name](10_000 + seed), seed)))
        total.update({key: int(value) for key, value in found.items()})
    return total


def compare_power(count: int) -> list[dict]:
    """What the power says of the weak effect, of whose people it knows mean and spread, beside what the analysis finds.

    count: tables of each.
    """
    plan, tables = paper_plan(), ObservedTables(paper_plan())
    people = [own for seed in range(200) for own in PEOPLE["weak effect, one group"](10_000 + seed)]
    shares = {shape: np.array([closed_share(own, shape, 1.0) for own in people]) for shape in OBJECTS}
    hits: Counter[str] = Counter()
    for seed in range(count):
        observers = PEOPLE["weak effect, one group"](50_000 + seed)
        (measure,) = choice_measures(tables.table(observers, seed))
        against = compare_with_centre_by_ranks(measure.by_participant(), 0.5, "")
        pairs = {own.compares: own for own in compare_pairs(measure, "object")}
        for sought, test in (("p_cc against chance", against), ("p_cc: cube - dog", pairs["cube - dog"])):
            hits[sought] += is_found(test) and (test.effect_size or 0.0) > 0.0
    found = []
    of_all = np.mean(list(shares.values()), axis=0)
    for sought, mean, other, factor in (
        ("p_cc against chance", of_all, None, None),
        ("p_cc: cube - dog", shares["cube"], shares["dog"], "object"),
    ):
        logits = np.log(mean / (1 - mean))
        options = {
            "measure": None, "mean": float(np.mean(mean)), "factor": factor,
            "mean_other": None if other is None else float(np.mean(other)), "spread": float(logits.std()),
            "opposite": None, "noise": None, "tables": max(count, 100), "seed": 1,
        }  # fmt: skip
        own = power_of(power_question(plan, options), 18)
        low, high = bound_proportion(hits[sought], count)
        found.append(
            {
                "sought": sought, "mean": options["mean"], "other": options["mean_other"],
                "spread": options["spread"], "power": own.power, "power_low": own.low, "power_high": own.high,
                "rate": hits[sought] / count, "rate_low": low, "rate_high": high,
            }
        )  # fmt: skip
    return found


def page_text(figures: dict, table_count: int) -> str:
    """The page of measured figures, as Markdown."""
    studies, rates = figures["studies"], figures["rates"]
    parts = [HEAD.format(studies=len(studies), tables=table_count)]
    rows = []
    for name in studies[0]["planted"]:
        planted_numbers = [own["planted"][name] for own in studies]
        numbers = [own["recovered"][name] for own in studies]
        errors = [a - b for a, b in zip(numbers, planted_numbers, strict=True)]
        rows.append(
            (
                name, f"{statistics.fmean(planted_numbers):.3f}", f"{statistics.fmean(numbers):.3f}",
                f"{statistics.fmean(errors):+.3f}", f"{max(map(abs, errors)):.3f}",
            )
        )  # fmt: skip
    parts.append(
        markdown_table(("", "planted, mean", "recovered, mean", "mean difference", "largest in one study"), rows)
    )
    found = Counter(name for own in studies for name, is_there in own["found"].items() if is_there)
    names = [name for name in studies[0]["found"] if not name.endswith("t-tests")]
    rows = [(name, f"{found[name]} of {len(studies)}") for name in names]
    parts.append(f"What the tests of these {len(studies)} studies find:\n\n{markdown_table(('', 'found in'), rows)}")
    parts.append(RATES.format(tables=table_count))
    kinds = list(rates)
    all_names = list(dict.fromkeys(name for own in rates.values() for name in own["found"]))
    rows = [(name, *(rate_text(rates[kind]["found"].get(name, 0), rates[kind]["tables"]) for kind in kinds))
            for name in all_names]  # fmt: skip
    parts.append(markdown_table(("found", *kinds), rows))
    parts.append(POWERS.format(tables=POWER_FACTOR * table_count))
    rows = [
        (
            own["sought"], f"{own['mean']:.3f}{'' if own['other'] is None else ' and {:.3f}'.format(own['other'])}",
            f"{own['spread']:.2f}", f"{own['power']:.3f} ({own['power_low']:.3f} to {own['power_high']:.3f})",
            f"{own['rate']:.3f} ({own['rate_low']:.3f} to {own['rate_high']:.3f})",
        )
        for own in figures["powers"]
    ]  # fmt: skip
    parts.append(
        markdown_table(("sought", "mean", "spread (logit)", "power by `--power`", "found by the analysis"), rows)
    )
    return "\n\n".join(parts) + "\n"


def rate_text(count: int, total: int) -> str:
    """A share with its 95 % binomial interval [%]."""
    low, high = bound_proportion(count, total)
    return f"{100 * count / total:.1f} ({100 * low:.1f} to {100 * high:.1f})"


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(line) + " |" for line in (head, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])


HEAD = """\
# The founding paper's study, by simulated people

No person took part. What stands here says that the protocol, the data file and the analysis give back what was put
into simulated people, and how often. It says nothing about what real people feel: p_cc, confidence and difficulty of
the paper cannot be made again without them.

`python benchmarks/simulated_study.py` runs the example plan `paper` (`palpate study example paper`): 18 people, three
objects at two opacities, ten trials a block. Simulated people are observers of signal detection theory. Each interval
gives a feeling, the stimulus' strength plus noise; the stronger feeling is called denser, with lapses (2 %); an opaque
object adds to the strength. Of 18 people three read closed contours as less dense and three feel nothing, as the paper
supposes. They share no code with the analysis.

## {studies} whole studies

Each went through the participant's page's own messages, on a virtual clock, into a data file: 1080 trials. Planted is
what the same people would answer with endless trials. `people` counts those whom the paper's rule calls so: five of six
cells on one side of chance. Of people who feel nothing, it calls a quarter `for` and a quarter `against`, so that fewer
indifferent people are recovered than are planted."""
RATES = """\
## How often it is found

The same people made {tables} tables of each kind, which went to the analysis alone. In percent, with 95 % binomial
intervals, tests at 5 %. Where nothing is felt, tests of participants must find something in 5 % of the tables or less.
Ranks with ties make them careful; a family of pairs is kept at 5 % by Holm's correction. `cells as observations` is
what the founding paper seems to have done. Where each person reads the contours one way or the other by the toss of a
coin (`two groups`), people as a whole are at chance; yet it finds an effect in many studies, as it takes the 60 answers
of one person for so much evidence. Objects do differ in the scales of `two groups`: confidence follows strength."""
POWERS = """\
## Power

`palpate study analyse --power` knows people by a mean and a spread alone; the observers are made otherwise. Of `weak
effect, one group`, 18 participants, each from {tables} studies of other seeds, with 95 % binomial intervals:"""

if __name__ == "__main__":
    sys.exit(main())
