"""Expansion: a slow oracle goes through every combination of values; plans that are too large are refused."""

import itertools
import json
import random

import pytest

from palpate.render.errors import PlanError
from palpate.render.sweeps.plan.loading import load_plans

SHORT = '[object]\nsource = "cube"\n'
CHOICES = {
    "object.source": ["cube", "tube", "dog", "sphere"],
    "object.fit": [0.08, 0.1, 0.12],
    "motion.duration": [1.0, 2.0, 3.0],
    "motion.seed": [1, 2, 3],
    "strategy.source": ["oc", "cc", "hatch"],
    "sampling.speed": [5.0, 6.0, 7.0],
}
"""Values that are drawn for each key, in the order in which keys vary."""
COLUMNS = ("object", "object_fit", "duration", "seed", "strategy", "speed")
DEFAULTS = ("cube", None, 30.0, 1, "cc", 7.0)


def load(folder, text):
    (folder / "plan.toml").write_text(text)
    return load_plans([folder / "plan.toml"])


def refusal(folder, text):
    with pytest.raises(PlanError) as caught:
        load(folder, text)
    return str(caught.value).replace(f"{folder}/", "")


def rows(plan):
    return [tuple(recipe.columns()[name] for name in COLUMNS) for recipe in plan.recipes()]


def random_plan(seed):
    """Tables by axis, groups of zip, and constraints: by key a list of values, or the least number."""
    rng = random.Random(seed)
    axes = {"object": [], "motion": [], "strategy": [], "sampling": []}
    for axis, tables in axes.items():
        keys = [key for key in CHOICES if key.startswith(axis)]
        own = [key for key in keys if key.endswith("source") or rng.random() < 0.7]
        for _ in range(rng.choice([1, 1, 2])):
            tables.append({key: [rng.choice(CHOICES[key]) for _ in range(rng.randint(1, 3))] for key in own})
    zipped = []
    for _ in range(rng.choice([0, 1, 1, 2])):
        free = [key for tables in axes.values() for key in tables[0] if key not in itertools.chain(*zipped)]
        single = [key for key in free if len(axes[key.partition(".")[0]]) == 1]
        if len(single) < 2:
            continue
        group = rng.sample(single, rng.randint(2, min(3, len(single))))
        lead = rng.choice(free) if rng.random() < 0.5 else group[0]  # one whose values are in several tables
        if lead.partition(".")[0] not in {key.partition(".")[0] for key in group}:
            group[0] = lead
        count = sum(len(table[group[0]]) for table in axes[group[0].partition(".")[0]])
        for key in group[1:]:
            axes[key.partition(".")[0]][0][key] = [rng.choice(CHOICES[key]) for _ in range(count)]
        zipped.append(group)
    constraints = []
    for _ in range(rng.choice([0, 0, 1, 2, 3])):
        entries = {}
        for key in rng.sample(list(CHOICES), rng.randint(1, 2)):
            some = rng.sample(CHOICES[key], 2)
            entries[key] = some if key.endswith("source") or rng.random() < 0.5 else min(some)
        constraints.append((rng.choice(["exclude", "exclude", "only"]), entries))
    return axes, zipped, constraints


def written(axes, zipped, constraints):
    """The plan's TOML; JSON's lists, texts and numbers are TOML's."""
    lines = [f"zip = {json.dumps(zipped)}"]
    for axis, tables in axes.items():
        for table in tables:
            lines += [f"[[{axis}]]", *(f"{key.partition('.')[2]} = {json.dumps(own)}" for key, own in table.items())]
    for kind, entries in constraints:
        lines.append(f"[[{kind}]]")
        for key, own in entries.items():
            lines.append(f'"{key}" = {json.dumps(own) if isinstance(own, list) else f"{{at_least = {own}}}"}')
    return "\n".join(lines)


def rows_by_trying_all(axes, zipped, constraints):
    """Rows of all combinations of places in the lists, filtered."""
    choices = []
    for tables in axes.values():
        before, own = dict.fromkeys(tables[0], 0), []
        for table in tables:
            for places in itertools.product(*(range(len(values)) for values in table.values())):
                own.append({key: (before[key] + k, table[key][k]) for key, k in zip(table, places, strict=True)})
            before = {key: count + len(table[key]) for key, count in before.items()}
        choices.append(own)
    found = []
    for parts in itertools.product(*choices):
        placed = {key: pair for part in parts for key, pair in part.items()}
        if any(len({placed[key][0] for key in group}) > 1 for group in zipped):
            continue
        full = {key: placed[key][1] if key in placed else own for key, own in zip(CHOICES, DEFAULTS, strict=True)}
        if is_kept(full, constraints):
            found.append(tuple(full.values()))
    return list(dict.fromkeys(found))


def is_kept(values, constraints):
    def matches(entries):
        numbers = {key: values[key] for key in entries if values[key] is not None}
        return all(
            key in numbers and (numbers[key] in own if isinstance(own, list) else numbers[key] >= own)
            for key, own in entries.items()
        )

    only = [matches(entries) for kind, entries in constraints if kind == "only"]
    return not any(matches(entries) for kind, entries in constraints if kind == "exclude") and (not only or any(only))


@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
@pytest.mark.exhaustive(after=2)
@pytest.mark.parametrize("first", range(0, 400, 10))
def test_recipes_are_all_combinations_that_are_allowed_in_order_each_once(tmp_path, first):
    for seed in range(first, first + 10):
        text, expected = written(*random_plan(seed)), rows_by_trying_all(*random_plan(seed))
        if expected:
            plan = load(tmp_path, text)
            assert (rows(plan), plan.recipe_count) == (expected, len(expected)), text
        else:
            assert "its constraints leave no recipe" in refusal(tmp_path, text)


@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
@pytest.mark.exhaustive(after=2)
@pytest.mark.parametrize("first", range(0, 200, 10))
def test_recipes_of_several_plans_are_those_of_each_once(tmp_path, first):
    paths, separate = [], []
    for seed in range(first, first + 10):
        axes, zipped, _ = random_plan(seed)
        paths.append(tmp_path / f"{seed}.toml")
        paths[-1].write_text(written(axes, zipped, []))
        separate += rows_by_trying_all(axes, zipped, [])
    plan = load_plans(paths)
    assert rows(plan) == list(dict.fromkeys(separate))
    assert len({recipe.hash for recipe in plan.recipes()}) == plan.recipe_count


BILLION = SHORT + "[motion]\nseed = {first = 1, count = 1000000000}\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BILLION, "not 1,000,000,000 recipes: list fewer values, or draw some of them with [sample]"),
        (BILLION + '[[only]]\n"motion.seed" = {at_most = 3}', "not 1,000,000,000 combinations of its axes"),
        (SHORT + "fit = {from = 1, to = 2, count = 1000}\n[motion]\nseed = {first = 1, count = 1001}",
         "not 1,001,000 recipes"),
    ],
)  # fmt: skip
def test_a_plan_of_more_than_a_million_recipes_is_refused_before_it_is_expanded(tmp_path, text, said):
    assert f"plan.toml: a plan must have at most 1,000,000 recipes, {said}" in refusal(tmp_path, text)


def test_drawn_rows_go_with_every_table_that_has_none(tmp_path):
    """A table without a range of [sample] is combined with each of its points, before and after one that has ranges."""
    text = '[sample]\nmethod = "random"\ncount = 3\n'
    text += '[[object]]\nsource = "cube"\nfit = {from = 0.1, to = 0.2}\n[[object]]\nsource = "tube"\n'
    text += "[[sampling]]\nspeed = {from = 2, to = 10}\n[[sampling]]\nspeed = 7.0\n"
    found = [(own[0], own[1], own[5]) for own in rows(load(tmp_path, text))]
    fits = [fit for name, fit, speed in found if name == "cube" and speed == 7.0]
    speeds = [speed for name, _, speed in found if name == "tube"]
    assert speeds[3:] == [7.0]
    points = zip(fits, speeds[:3], strict=True)
    cubes = [row for fit, speed in points for row in (("cube", fit, speed), ("cube", fit, 7.0))]
    assert found == cubes + [("tube", None, speed) for speed in speeds]
    assert len({*fits, *speeds}) == 7
