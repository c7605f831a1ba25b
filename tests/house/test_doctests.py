"""The example at the end of each public name's docstring: it is there, runs as it stands, and shows what it says."""

import doctest
from importlib import import_module

import pytest

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
