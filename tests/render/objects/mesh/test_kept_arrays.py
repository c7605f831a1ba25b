"""Entries kept on disk are named by every source that decides about them."""

import ast
from pathlib import Path

import pytest

from palpate.render.objects.mesh import kept_edges, kept_repairs

ROOT = Path(__file__).parents[4]


@pytest.mark.parametrize(
    ("keeper", "maker"),
    [(kept_repairs, "render/objects/mesh/repair.py"), (kept_edges, "kernels/section/half_edges.py")],
)
def test_every_source_that_decides_about_the_result_is_in_the_key(keeper, maker):
    found, waiting = set(), [ROOT / maker]
    while waiting:
        path = waiting.pop()
        found.add(path)
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = path.parents[node.level - 1]
                named = base.joinpath(*(node.module or "").split(".")).with_suffix(".py")
                waiting += [named] if named.exists() and named not in found else []
    assert {str(path.relative_to(ROOT)) for path in found} == set(keeper.SOURCES)
