"""TOML of strangers: keys of many parts are refused before they take memory; all else is what tomllib reads."""

import tomllib
import tracemalloc

import pytest

from palpate.render.errors import PlanError
from palpate.render.sweeps.plan.document import put_override
from palpate.render.sweeps.plan.line_search import parse_toml
from palpate.render.sweeps.plan.loading import load_plans
from palpate.render.sweeps.plan.values import PlanFault


@pytest.mark.parametrize("part", ["a.", "a . ", '"a" .', "'.'.", r'"\"".'])
@pytest.mark.parametrize("place", ["{}", "[{}]", "[[{}]]", "x = {{ y = 1, {} = 2 }}"])
def test_a_key_of_many_parts_is_refused_before_it_takes_memory(part, place, tmp_path, monkeypatch):
    key = part * 3000 + "b"
    monkeypatch.setattr("tomllib.loads", pytest.fail)
    tracemalloc.start()
    (tmp_path / "plan.toml").write_text("\n" + place.format(key) + ("" if "[" in place or "x" in place else " = 1"))
    with pytest.raises(PlanError, match=r"plan\.toml:2: not TOML: a key has more than 32 parts"):
        load_plans([tmp_path / "plan.toml"])
    with pytest.raises(PlanFault, match="more than 32 parts"):
        put_override({}, f"name = {{ {key} = 1 }}", ["name"])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2_000_000


@pytest.mark.exhaustive
def test_toml_is_what_it_was():
    """Up to the bound, and whatever looks alike: numbers, ellipses, texts; and in linear time what nearly is a key."""
    key = ".".join(["a"] * 32)
    for text in (f"{key} = 1", "x = [" + "1.5, " * 999 + "]", f"x = '{'.' * 999}' # {'and so on ... ' * 99}"):
        assert parse_toml(text) == tomllib.loads(text)
    for text in ("a" * 10**6, '"' + r"\"" * 10**6, "a" + " " * 10**6, "'" * 10**6, '"a"' * 10**6, "[" * 10**6):
        with pytest.raises(ValueError, match=r"."):
            parse_toml(text)
    with pytest.raises(ValueError, match="holds 16777217 characters"):
        parse_toml("#" * ((1 << 24) + 1))
