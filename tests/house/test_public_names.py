"""Public names: help that ends with an example that runs, names that type checkers know, objects in one line."""

import ast
import builtins
import doctest
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("palpate.render", "palpate.datasets", "palpate.device")
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
SLOW = {"ImplicitObject", "isosurface", "draw_figure", "simplify", "predict_noise"}
SLOW |= {"Live", "LiveMoment", "LiveRecording", "LiveScene", "RunStatistics", "Session"}
"""Names whose examples take over 0.2 s."""


def public_names():
    """Functions and classes that the packages name, each once; errors explain themselves by their message."""
    found = {}
    for package in map(import_module, PACKAGES):
        for name in package.__all__:
            value = getattr(package, name)
            is_error = isinstance(value, type) and issubclass(value, BaseException)
            if callable(value) and not is_error:
                found.setdefault(name, (f"{package.__name__}.{name}", value))
    return list(found.values())


SHORT = 280
EXPRESSIONS = {
    "palpate.render.ContourFile": 'ContourFile(render("cube", "palm", static_pose([0, 0, 0.2])).save("own.h5"))',
    "palpate.render.DriveStrategy": "DriveStrategy(solver='wgs')",
    "palpate.render.Driver": 'Driver("emulator")',
    "palpate.render.FocalPoints": 'render("cube", "palm", static_pose([0, 0, 0.2])).sample(duration=0.1).focus',
    "palpate.render.Hand": "Palm()",
    "palpate.render.InProcess": "InProcess()",
    "palpate.render.PatchJoint": "PatchJoint(0, 3, 1, 1)",
    "palpate.render.LiveRecording": None,
    "palpate.render.Onset": "Onset(time=12.5, latency=0.004, is_estimate=False)",
    "palpate.render.SamplingStrategy": "SamplingStrategy()",
    "palpate.render.SeenHand": 'SeenHand(12.5, "right", "1", [0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0])',
    "palpate.render.SourceFault": 'SourceFault("battery", "battery: 3 % are left")',
    "palpate.render.SweepResult": "sweep('study.toml', {'motion.source': 'still.csv'})",
    "palpate.datasets.ContourWriter": None,
    "palpate.device.Clock": "VirtualClock()",
    "palpate.device.EmulationRequest": "EmulationRequest(serials=('A',), clock=None, record=0, baud=None)",
    "palpate.device.Limits": "Limits()",
    "palpate.device.Player": "Player(open_link(array_model('emulator'), clock=VirtualClock()))",
    "palpate.device.LinkRequest": "LinkRequest(serial='A')",
    "palpate.device.Link": "open_link(array_model('emulator'), clock=VirtualClock())",
    "palpate.device.Underrun": "Underrun(0.05, 256, 0.024, 50_000_000, None)",
}
"""Objects of classes that no example leaves behind; None: none can be made outside a `with`."""


def run_example(name, value):
    """Run the example of a docstring; its parts, its variables and the failures that it reported."""
    example = doctest.DocTestParser().get_doctest(value.__doc__, {}, name, None, 0)
    failures = []
    builtins._ = None
    doctest.DocTestRunner(optionflags=OPTIONS).run(example, out=failures.append, clear_globs=False)
    return example.examples, [*example.globs.values(), builtins._], failures


def objects_of(kind, name, variables):
    """Objects of a class: from its expression, or variables of its example and their attributes."""
    if EXPRESSIONS.get(name):
        package = import_module(name.rpartition(".")[0])
        return [eval(EXPRESSIONS[name], {n: getattr(package, n) for n in package.__all__})]
    listed = [part for one in variables for part in (one if isinstance(one, list | tuple) else (one,))]
    inner = [part for one in listed if type(one).__module__.startswith("palpate.") for part in attributes_of(one)]
    return [one for one in (*listed, *inner) if isinstance(one, kind)]


def attributes_of(one):
    return list(getattr(one, "__dict__", {}).values())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        pytest.param(*case, id=case[0], marks=pytest.mark.exhaustive if case[0].rpartition(".")[2] in SLOW else ())
        for case in public_names()
    ],
)
def test_help_ends_with_an_example_that_runs_and_its_objects_are_printed_in_one_line(
    name, value, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    purpose = value.__doc__.split("\n\n")[0]
    assert purpose.strip().endswith((".", ":")), purpose
    examples, variables, failures = run_example(name, value)
    assert examples, f"{name} has no example"
    assert examples[-1].want, f"{name}: the example ends without showing anything"
    assert not failures, "".join(failures)
    last = value.__doc__.rstrip().splitlines()[-1].strip()
    shown = [line.strip() for line in examples[-1].want.splitlines()]
    assert last in shown, f"{name}: text follows the example: {last}"
    if not isinstance(value, type) or EXPRESSIONS.get(name, "") is None:
        return
    found = objects_of(value, name, variables)
    assert found, f"{name}: no object to look at"
    for text in {repr(one) for one in found}:
        assert "\n" not in text, text
        assert " at 0x" not in text, text
        assert "array(" not in text, text
        assert len(text) <= SHORT, text


@pytest.mark.exhaustive
def test_examples_run_one_after_the_other_in_one_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, value in public_names():
        failures = run_example(name, value)[2]
        assert not failures, "".join(failures)


@pytest.mark.parametrize("package", ["render", "datasets", "device"])
def test_type_checkers_know_every_public_name_and_no_other(package):
    """The imports that only type checkers see give `__all__`, and the function that finds names is hidden from them."""
    tree = ast.parse((ROOT / package / "__init__.py").read_text())
    guarded = [node for node in tree.body if isinstance(node, ast.If)]
    seen = {name.name for node in guarded for part in node.body for name in getattr(part, "names", [])}
    assert seen == set(import_module(f"palpate.{package}").__all__)
    assert not [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "__getattr__"]
    assert (ROOT / package / "py.typed").exists()
    assert dir(import_module(f"palpate.{package}")) == sorted([*seen, "__version__"])  # what completion offers
