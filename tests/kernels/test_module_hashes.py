"""A module has one hash, so that a cache of kernels that was filled once and is then read-only suffices.

Warp takes `e.winding` for the constant `wp.e` as long as the function's code has not been generated, and for a variable
afterwards: the hash of what calls such a function then depends on whether another module came from the cache.
"""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp

import palpate.kernels

FOLDER = Path(next(iter(palpate.kernels.__path__)))
LAUNCHES = ("launch", "launch_tiled", "partial")
CONSTANTS = {name for name in dir(wp) if isinstance(getattr(wp, name), int | float)}
RENDER = """
from palpate.render import exploration
from palpate.render import MeshObject, Palm, closed_contour, render
tube = MeshObject.load("tube")
render(tube, Palm(), exploration(tube.bounds, duration=0.5, seed=1), closed_contour()).lengths()
"""


def is_warps(decorator):
    """Whether a decorator is one of Warp's, called or not."""
    return any(isinstance(node, ast.Name) and node.id == "wp" for node in ast.walk(decorator))


def attributes_of_locals(source):
    """Names of variables and arguments of Warp functions whose attributes are used."""
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef) or not any(map(is_warps, function.decorator_list)):
            continue
        stored = {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and type(node.ctx) is ast.Store}
        own = stored | {argument.arg for argument in function.args.args}
        for node in ast.walk(function):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in own:
                yield node.value.id


def test_no_variable_with_attributes_has_the_name_of_a_constant():
    assert {"e", "pi"} <= CONSTANTS
    suspicious = re.compile(rf"\b({'|'.join(CONSTANTS)})\.[a-z]")
    found = {
        (path.name, name)
        for path in FOLDER.rglob("*.py")
        if suspicious.search(path.read_text())
        for name in attributes_of_locals(path.read_text())
        if name in CONSTANTS
    }
    assert found == set()


def test_the_check_sees_such_a_variable():
    assert list(attributes_of_locals("@wp.func\ndef f(e: E):\n    return e.x")) == ["e"]


def launches_without_block(source):
    """Lines of launches that leave the size of a GPU's blocks to Warp."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in LAUNCHES:
            called = [ast.unparse(argument) for argument in (node.func, *node.args[:1])]
            is_launch = called[0] in ("wp.launch", "wp.launch_tiled") or called == ["partial", "wp.launch"]
            if is_launch and not {"block_dim", None} & {keyword.arg for keyword in node.keywords}:
                yield node.lineno


@pytest.mark.exhaustive
def test_every_launch_names_its_block():
    """Warp compiles a module for a GPU once for each size of blocks: with one left open, twice, for minutes."""
    texts = {path.name: path.read_text() for path in FOLDER.rglob("*.py")}
    found = {(name, line) for name, text in texts.items() if "launch" in text for line in launches_without_block(text)}
    assert found == set()


def test_the_check_sees_such_a_launch():
    assert list(launches_without_block("wp.launch(f, 3)\nwp.launch(f, 3, block_dim=64)\nwp.launch(f, **same)")) == [1]


@pytest.mark.exhaustive
def test_a_second_process_compiles_nothing(tmp_path):
    tmp_path.chmod(0o700)
    kept = []
    for _ in range(2):
        environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path)}
        subprocess.run([sys.executable, "-P", "-c", RENDER], env=environment, check=True, capture_output=True)
        kept.append(sorted(path.name for path in tmp_path.glob("*/*")))
    assert len(kept[0]) > 3
    assert kept[0] == kept[1]
