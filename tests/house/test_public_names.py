"""What scripts see: help that ends with an example that runs, names that type checkers know, objects in one line."""

import ast
import doctest
import gc
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("palpate.render", "palpate.datasets", "palpate.device")
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


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


CLASSES = {name: value for name, value in public_names() if isinstance(value, type)}
SHORT = 280
EXPRESSIONS = {
    "palpate.render.ContourFile": 'ContourFile(render("cube", "palm", static_pose([0, 0, 0.2])).save("own.h5"))',
    "palpate.render.DriveStrategy": "DriveStrategy(solver='wgs')",
    "palpate.render.Driver": 'Driver("emulator")',
    "palpate.render.Hand": "Palm()",
    "palpate.render.InProcess": "InProcess()",
    "palpate.render.PatchJoint": "PatchJoint(0, 3, 1, 1)",
    "palpate.render.SweepResult": "sweep('study.toml', {'motion.source': 'still.csv'})",
    "palpate.datasets.ContourWriter": None,
    "palpate.device.Clock": "VirtualClock()",
    "palpate.device.EmulationRequest": "EmulationRequest(serials=('A',), clock=None, record=0, baud=None)",
    "palpate.device.Fault": "Fault(FaultKind.TIMEOUT, byte=100)",
    "palpate.device.Player": "Player(open_link(array_model('emulator'), clock=VirtualClock()))",
    "palpate.device.LinkRequest": "LinkRequest(serial='A')",
    "palpate.device.Link": "open_link(array_model('emulator'), clock=VirtualClock())",
}
"""Objects of classes that no example leaves behind."""


@pytest.mark.parametrize(("name", "value"), [pytest.param(*case, id=case[0]) for case in public_names()])
def test_help_starts_with_a_purpose_and_ends_with_an_example_that_runs(name, value, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    purpose = value.__doc__.split("\n\n")[0]
    assert purpose.strip().endswith((".", ":")), purpose
    examples = doctest.DocTestParser().get_doctest(value.__doc__, {}, name, None, 0)
    assert examples.examples, f"{name} has no example"
    assert examples.examples[-1].want, f"{name}: the example ends without showing anything"
    told = []
    result = doctest.DocTestRunner(optionflags=OPTIONS).run(examples, out=told.append)
    assert result.failed == 0, "".join(told)
    last = value.__doc__.rstrip().splitlines()[-1].strip()
    shown = [line.strip() for line in examples.examples[-1].want.splitlines()]
    assert last in shown, f"{name}: text follows the example: {last}"


@pytest.mark.exhaustive  # each by itself runs always
def test_examples_run_one_after_the_other_in_one_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = []
    for name, value in public_names():
        examples = doctest.DocTestParser().get_doctest(value.__doc__, {}, name, None, 0)
        doctest.DocTestRunner(optionflags=OPTIONS).run(examples, out=told.append)
    assert not told, "".join(told)


@pytest.mark.parametrize("package", ["render", "datasets", "device"])
def test_type_checkers_know_every_public_name_and_no_other(package):
    """The imports that only type checkers see give `__all__`, and the function that finds names is hidden from them."""
    tree = ast.parse((ROOT / package / "__init__.py").read_text())
    guarded = [node for node in tree.body if isinstance(node, ast.If)]
    seen = {name.name for node in guarded for part in node.body for name in getattr(part, "names", [])}
    assert seen == set(import_module(f"palpate.{package}").__all__)
    assert not [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "__getattr__"]
    assert (ROOT / package / "py.typed").exists()


@pytest.mark.parametrize("name", CLASSES)
def test_an_object_prints_itself_as_one_line_of_facts(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example = doctest.DocTestParser().get_doctest(CLASSES[name].__doc__, {}, name, None, 0)
    doctest.DocTestRunner(optionflags=OPTIONS).run(example, out=lambda text: None, clear_globs=False)
    if EXPRESSIONS.get(name):
        package = import_module(name.rpartition(".")[0])
        made = eval(EXPRESSIONS[name], {n: getattr(package, n) for n in package.__all__})
        found = [made]
    else:
        gc.unfreeze()  # what conftest.py froze is not listed
        found = [thing for thing in gc.get_objects() if issubclass(type(thing), CLASSES[name])]
        gc.freeze()
    if EXPRESSIONS.get(name, "") is not None:
        assert found, f"{name}: no object to look at"
    for text in {repr(thing) for thing in found}:
        assert "\n" not in text, text
        assert " at 0x" not in text, text
        assert "array(" not in text, text
        assert len(text) <= SHORT, text
