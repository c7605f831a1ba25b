"""Plans: what they stand for, what is refused and where, overrides, constraints, unions, and how lazy they are."""

import itertools
import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from palpate.render.errors import PalpateWarning, PlanError
from palpate.render.sweeps.plan.axes import KEYS
from palpate.render.sweeps.plan.loading import load_plans

DOCUMENT = Path(__file__).parents[4] / "docs/guide/sweep-plan.md"
SHORT = '[object]\nsource = "cube"\n'


@pytest.fixture
def folder(tmp_path):
    """A folder with files of every kind that plans name."""
    for name in ("meshes", "strategies", "volumes"):
        (tmp_path / name).mkdir()
    for name in "ab":
        (tmp_path / "meshes" / f"{name}.stl").write_text(f"solid {name}")
        np.save(tmp_path / "volumes" / f"{name}.npy", np.full((4, 4, 4), ord(name)))
    (tmp_path / "strategies" / "mine.json").write_text('{"prune": ["outside"], "transform": ["close", "smooth"]}')
    return tmp_path


def load(folder, text, *overrides, name="plan.toml"):
    path = folder / name
    path.write_text(text)
    return load_plans([path], overrides)


def refusal(folder, text, *overrides):
    """The faults that a plan is refused with, the folder's name left out."""
    with pytest.raises(PlanError) as caught:
        load(folder, text, *overrides)
    return str(caught.value).replace(f"{folder}/", "")


def column(plan, name):
    return [recipe.columns()[name] for recipe in plan.recipes()]


# What a plan stands for


def test_patterns_are_sorted_and_paths_start_from_the_plan(folder):
    plan = load(folder, '[object]\nsource = ["meshes/[ba].stl", "tube"]\n[strategy]\nsource = "**/*.json"')
    assert [r.thing["source"] for r in plan.recipes()] == [f"{folder}/meshes/a.stl", f"{folder}/meshes/b.stl", "tube"]
    assert plan.recipes()[0].strategy["described"]["transform"] == ["close", "smooth"]


RANGES = [
    ("7", [7.0]),
    ("{from = 5.0, to = 9, count = 5}", [5, 6, 7, 8, 9]),
    ("{from = 0.1, to = 0.7, count = 7}", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]),
    ("{from = 5.0, to = 5.35, step = 0.1}", [5.0, 5.1, 5.2, 5.3]),
    ("{from = 0.01, to = 100, count = 5, log = true}", [0.01, 0.1, 1, 10, 100]),
    ("{from = 3, to = 3, count = 1}", [3.0]),
]


def test_ranges_are_the_numbers_as_they_would_be_written(folder):
    for value, numbers in RANGES:
        assert column(load(folder, f"{SHORT}[sampling]\nspeed = {value}"), "speed") == numbers


def test_what_is_there_twice_is_made_once_and_told(folder):
    with pytest.warns(PalpateWarning, match=r"plan\.toml:3: object\.fit: is listed before"):
        assert load(folder, SHORT + "fit = [0.1, 0.2, 0.10]").recipe_count == 2
    (folder / "meshes" / "b.stl").write_text("solid a")
    with pytest.warns(PalpateWarning, match=r"object: 1 of 2 values are the same .* a\.stl and b\.stl"):
        assert load(folder, '[object]\nsource = "meshes/*"').recipe_count == 1


# Constraints

CROSS = (
    '[object]\nsource = ["cube", "tube", "meshes/*.stl"]\nfit = [0.05, 0.1, 0.2]\n'
    '[strategy]\nsource = ["oc", "cc", "hatch"]\n'
)


@pytest.mark.parametrize(
    ("constraint", "kept"),
    [
        ('[[exclude]]\nstrategy.source = ["oc", "hatch"]\nobject.fit = 0.1', lambda o, f, s: s == "cc" or f != 0.1),
        ('[[only]]\n"object.fit" = {at_least = 0.1, at_most = 0.1}', lambda o, f, s: f == 0.1),
        (
            '[[only]]\n"object.source" = "meshes/*"\n[[exclude]]\nobject.fit = 0.2',
            lambda o, f, s: o.endswith("stl") and f != 0.2,
        ),
        ('[[exclude]]\n"object.source" = ["*.stl", "cube"]', lambda o, f, s: o == "tube"),
        ('[[exclude]]\nhand.palm = [[0.085, 0.085], [1, 1]]\nstrategy.source = "cc"', lambda o, f, s: s != "cc"),
    ],
)
def test_constraints_leave_out_what_they_say(folder, constraint, kept):
    plan = load(folder, CROSS + constraint)
    rows = [(r.thing["name"], r.thing["fit"], r.strategy["name"]) for r in plan.recipes()]
    every = itertools.product(["cube", "tube", "a.stl", "b.stl"], [0.05, 0.1, 0.2], ["oc", "cc", "hatch"])
    assert rows == [row for row in every if kept(*row)]
    assert plan.recipe_count == len(rows)


def test_constraints_on_what_does_not_apply_match_nothing_and_are_told(folder):
    with pytest.warns(PalpateWarning, match=r"plan\.toml:6: exclude: matches nothing"):
        assert load(folder, CROSS + '[[exclude]]\n"strategy.step" = {at_least = 0}').recipe_count == 36
    with pytest.warns(PalpateWarning, match=r"plan\.toml:6: exclude: matches nothing"):
        load(folder, CROSS + '[[exclude]]\n"strategy.source" = "corners"')


# Bad input: (what stands in the plan, what is said of it)

FAULTS = [
    ("[object]\nfit = 0.1", "plan.toml:1: object.source: is missing"),
    (f"{SHORT}fitt = 1", "plan.toml:3: object.fitt: unknown key (did you mean 'fit'?); known: source, scale"),
    (f"{SHORT}[motion]\nspeed = 3", "plan.toml:4: motion.speed: unknown key (it is a key of sampling); known"),
    ("object = []", "plan.toml:1: object: must have at least one table, not []"),
    ('[object]\nsource = "nothing/*.stl"', "plan.toml:2: object.source: no file matches 'nothing/*.stl' in"),
    ('[object]\nsource = [\n"cube",\n"tub",\n]', "plan.toml:4: object.source: 'tub' is no built-in object (cube, sph"),
    ('[object]\nsource = "tub"', "(did you mean 'tube'?)"),
    (
        f"{SHORT}fit = 80",
        "plan.toml:3: object.fit: must lie in 0.001..5 m, not 80; lengths are in metres, 80 mm are 0.08",
    ),
    (
        f'{SHORT}[sampling]\nspeed = "7 mm/s"',
        "must be a number in 0.001..100 m/s, without quotes, not '7 mm/s': write 0.007",
    ),
    (f"{SHORT}fit = [\n0.1,\ntrue]", "plan.toml:5: object.fit: must be a number in 0.001..5 m, not True"),
    (f'{SHORT}up = "w"', "plan.toml:3: object.up: must be one of x, y, z, -x, -y, -z, not 'w'"),
    (f"{SHORT}up = {{from = 1, to = 2, count = 2}}", "plan.toml:3: object.up: cannot be a range"),
    (
        f"{SHORT}[sampling]\nspeed = {{from = 9, to = 5, count = 3}}",
        "plan.toml:4: sampling.speed.from: must be at most",
    ),
    (f"{SHORT}[sampling]\nspeed = {{from = 5, to = 9, count = 1}}", "count must be 2 or more from 5 to 9, not 1"),
    (f"{SHORT}[sampling]\nspeed = {{from = 5, to = 9, step = 0}}", "sampling.speed.step: must be above 0, not 0"),
    (f"{SHORT}fit = {{from = 0.1, to = 1.0, step = 1e-300}}", "object.fit.step: must be larger: more than 1e+06"),
    (
        f"{SHORT}[sampling]\nspeed = {{from = 5, to = 9, cout = 3}}",
        "sampling.speed.cout: unknown key 'cout' of a range",
    ),
    (
        f"{SHORT}[sampling]\nspeed = {{from = 5, to = 9}}",
        "a range is from, to and count, or from, to and step, or first",
    ),
    (f"{SHORT}[sampling]\nspeed = {{first = 5, count = 9}}", "first and count are of whole numbers"),
    (f"{SHORT}[motion]\nseed = {{from = 1, to = 4, count = 3}}", "3 whole numbers from 1 on cannot be 1.5 apart"),
    (
        f"{SHORT}[motion]\nduration = 1e8",
        "motion.duration: must give at most 1e+09 poses with rate, not 1e+08 s at 90 Hz",
    ),
    (f'{SHORT}[motion]\nsource = "random"', "plan.toml:3: motion.count: is missing, which random needs"),
    (f"{SHORT}[motion]\nsize = 0.1", "plan.toml:4: motion.size: is of random, which exploration is not"),
    (f"{SHORT}unit = 'mm'", "plan.toml:3: object.unit: is of volume, which cube is not"),
    (
        f'{SHORT}[hand]\nsource = ["palm", "skin"]\npalm = [0.1, 0.1]',
        "plan.toml:5: hand.palm: is of palm, which skin is not; give it an [[hand]] of its own",
    ),
    (
        f'{SHORT}[sampling]\nsource = "am"\nupdate_rate = 300',
        "plan.toml:3: sampling: am.frequency must be at most half",
    ),
    (f'{SHORT}[array]\nsolver = "naive"\nwgs_iterations = 2', "plan.toml:3: array: wgs_iterations is 2, but solver"),
    (
        f'keep = ["drives"]\n{SHORT}[array]\nsource = "sonicsurface"',
        "plan.toml:1: keep: drives of stm cannot be played",
    ),
    (
        f'keep = ["drives"]\n{SHORT}[array]\nsource = "stratos"',
        "drives of stm cannot be played: array stratos takes focal points",
    ),
    (
        f'metrics = ["noise", "pressure"]\n{SHORT}[array]\nsource = "sonicsurface"',
        "plan.toml:1: metrics: noise and pressure of stm cannot be predicted",
    ),
    (f"metrics = []\n{SHORT}", "plan.toml:1: metrics: is empty, and there is nothing to keep either"),
    (f'device = "gpu"\n{SHORT}', "plan.toml:1: device: must be auto, cpu, cuda, cuda:0 or a list of these, not 'gpu'"),
    (f"{SHORT}[[only]]\n'object.fit' = {{least = 3}}", "plan.toml:4: only.object.fit: must have at_least, at_most or"),
    (f"{SHORT}[[exclude]]\n'object.source' = 'c*'", "plan.toml: its constraints leave no recipe"),
    ('[object]\nsource = "cube', "plan.toml:2: not TOML: "),
]


@pytest.mark.exhaustive(after=3)
@pytest.mark.parametrize("first", range(0, len(FAULTS), 10))
def test_what_cannot_be_is_refused_with_file_line_key_value_and_bound(folder, first):
    for text, said in FAULTS[first : first + 10]:
        told = refusal(folder, text)
        assert said in told
        assert "\n" not in told


def test_all_faults_are_told_at_once(folder):
    told = refusal(folder, f"metrics = 3\n{SHORT}fit = 80\nup = 'Q'\n[[hand]]\n[[hand]]\nsource = 'glove'\npalm = 3\n")
    assert sorted(re.match(r"(.*?:\d: [a-z.]+):", line)[1] for line in told.splitlines()) == [
        "plan.toml:1: metrics",
        "plan.toml:4: object.fit",
        "plan.toml:5: object.up",
        "plan.toml:8: hand.source",
        "plan.toml:9: hand.palm",
    ]


# Overrides


def test_overrides_take_the_place_of_what_the_plan_says(folder):
    text = SHORT + "[motion]\nseed = [1, 2, 3]\n[[exclude]]\n'motion.seed' = 2"
    plan = load(folder, text, "motion.seed={first=7,count=2}", "object.source=tube", "exclude=[]", "keep=['contours']")
    assert column(plan, "seed") == [7, 8]
    assert set(column(plan, "object")) == {"tube"}
    assert "keep-contours" in plan.groups


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("object.fit=80", "--set object.fit=80: object.fit: must lie in 0.001..5 m, not 80"),
        ("motion.seed={first=1,count=0}", "--set motion.seed={first=1,count=0}: motion.seed.count: must lie"),
        ("object.fitt=1", "--set object.fitt=1: object.fitt: unknown key (did you mean 'fit'?)"),
        ("obj.fit=1", "--set obj.fit=1: unknown key"),
        ("object.fit.x=1", "--set object.fit.x=1: unknown key"),
        ("object.fit", "--set object.fit: must be key=value"),
        ("object.source=a b", "--set object.source=a b: not a TOML value"),
        ("object.fit=1\nper_pose=true", "not a TOML value (more than one value)"),
        ("hand=3", "--set hand=3: hand: must be a table, not 3"),
    ],
)
def test_bad_overrides_are_told_as_they_were_given(folder, override, said):
    assert said in refusal(folder, SHORT, override)


# Unions


def test_plans_that_run_together_agree_on_devices_and_unite_what_they_ask_for(folder):
    for name, text in (("a", 'device = "cpu"\n'), ("b", 'keep = ["contours"]\n'), ("c", 'device = "cuda"\n')):
        (folder / f"{name}.toml").write_text(text + SHORT)
    plan = load_plans([folder / "a.toml", folder / "b.toml"])
    assert (plan.name, plan.device, plan.groups) == ("a+b", "cpu", ("contours", "frequency", "keep-contours"))
    assert plan.recipe_count == len(plan.recipes()) == 1
    with pytest.raises(
        PlanError, match=r"device: plans that are run together must agree, not cpu in .*a\.toml and cuda"
    ):
        load_plans([folder / "a.toml", folder / "c.toml"])
    assert load_plans([folder / "a.toml", folder / "c.toml"], ["device=cpu"]).device == "cpu"


def test_plans_are_told_apart(folder):
    digests = [
        load(folder, text, *overrides).digest
        for text, *overrides in ([SHORT], [SHORT, "object.fit=0.1"], [SHORT, "per_pose=true"], [SHORT + "fit = 0.1"])
    ]
    assert len(set(digests)) == 4
    assert load(folder, SHORT).digest == digests[0]
    (folder / "meshes" / "b.stl").unlink()
    before = load(folder, '[object]\nsource = "meshes/*"').digest
    (folder / "meshes" / "a.stl").write_text("solid changed")
    changed = load(folder, '[object]\nsource = "meshes/*"').digest
    assert changed != before
    (folder / "meshes" / "a.stl").rename(folder / "meshes" / "x.stl")  # tables and constraints have names
    assert load(folder, '[object]\nsource = "meshes/*"').digest != changed


# The document


def test_the_document_tells_every_key(folder):
    text = DOCUMENT.read_text()
    for axis, keys in KEYS.items():
        section = text.partition(f"| `[{axis}]` |")[2].partition("\n\n")[0]
        assert {name for name in ("source", *keys) if f"`{name}`" not in section} == set()


# Whatever is written

ODD = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**400), 10**400)
    | st.floats()
    | st.text("a*[]:.\0/~%é{", max_size=5)
    | st.sampled_from(["cube", "random", "1979-05-27", "07:32:00"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["from", "to", "count", "step", "first", "log", "at_least", "x"]), inner, max_size=3
        )
    ),
    max_leaves=5,
)
PLACES = [*(f"{axis}.{key}" for axis, keys in KEYS.items() for key in ("source", *keys)), "metrics", "keep", "per_pose"]
PLACES += ["device", "workers", "exclude", "only", "zip", "sample", "sample.count", "sample.method", *KEYS]


def toml(value):
    """A value as TOML writes it; dates and times stand for none and for texts that look like them."""
    if value is None or value in ("1979-05-27", "07:32:00"):
        return "1979-05-27T07:32:00Z" if value is None else value
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return (
        str(value).lower()
        if isinstance(value, bool)
        else json.dumps(value).replace("N", "n").replace("Infinity", "inf")
    )


@pytest.mark.exhaustive
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=300)
@given(place=st.sampled_from(PLACES), value=ODD)
def test_whatever_is_written_is_a_plan_or_refused(folder, place, value):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PalpateWarning)
        try:
            plan = load(folder, SHORT, f"{place}={toml(value)}")
        except PlanError:
            return
    assert plan.recipes()[0].hash
