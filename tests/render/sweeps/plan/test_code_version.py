"""The code version: which modules and libraries decide it, and which changes of a source change it."""

import ast
import json
import re
import shutil
import subprocess
import sys
import time
from importlib.metadata import version

import pytest
import traced_tasks

from palpate.render.sweeps.plan import code_version as module
from palpate.render.sweeps.plan.code_version import (
    COMPUTING,
    HOUSE,
    LIBRARIES,
    PACKAGES,
    code_version,
    import_closure,
    modules_digest,
)

REGISTERED = (
    "device/",
    "datasets/focus_files/ptlist.py",
    "datasets/recordings/sample.py",
    "render/runtime/warp_start.py",
    "render/runtime/kernel_cache.py",
)
"""Modules that are loaded and decide no number: arrays' links, exports, and where Warp keeps what it compiles."""


def test_the_code_version_names_a_digest_and_every_library():
    code, *libraries = code_version().split(", ")
    assert code == f"palpate code {modules_digest(COMPUTING)}"
    assert len(code.rpartition(" ")[2]) == 16
    assert libraries == [f"{name} {version(name)}" for name in LIBRARIES]


def test_another_version_of_a_library_is_another_code_version(monkeypatch):
    own = code_version()
    for changed in LIBRARIES:
        monkeypatch.setattr(module, "version", lambda name, of=changed: "0.0" if name == of else version(name))
        other = code_version.__wrapped__()
        assert other != own
        assert f"{changed} 0.0" in other


def outside_kernels(paths):
    """Paths outside kernels/: most modules in it hold only what Warp compiles, which a trace of Python does not see."""
    return {path for path in paths if not path.startswith("kernels/")}


@pytest.mark.exhaustive
def test_every_module_that_runs_in_a_task_counts(tmp_path, monkeypatch):
    monkeypatch.setenv("PALPATE_CACHE", "off")  # meshes are repaired, not read
    command = [sys.executable, "-W", "ignore", traced_tasks.__file__, str(tmp_path)]
    monkeypatch.setenv("PYTHONPATH", ":".join(sys.path))
    told = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1])
    assert told["failures"] == []
    counted = set(import_closure(COMPUTING))
    ran = {path for path in told["ran"] if path.split("/")[0] in PACKAGES}  # a virtual environment may lie beside them
    proving = {f"render/runtime/{name}.py" for name in ("sealed_kernels", "kernel_cache", "interrupt")}
    assert ran - counted <= proving  # of compiled kernels, before they run: nothing is computed there
    assert len(outside_kernels(ran)) > 0.7 * len(outside_kernels(counted))
    loaded = {name.removeprefix("palpate.").replace(".", "/") for name in told["modules"]}
    modules = {f"{name}.py" for name in loaded if (HOUSE / f"{name}.py").is_file()}
    assert {path for path in modules - counted - proving if not path.startswith(REGISTERED)} == set()


def closure_by_syntax_tree(roots):
    """The same closure, from Python's syntax trees."""
    left = [path for root in roots for path in HOUSE.glob(root)]
    found = set(left)
    while left:
        path = left.pop()
        for node in statements(ast.parse(path.read_text())):
            base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for name in node.names:
                files = (base.with_suffix(".py"), base / f"{name.name}.py", base / "__init__.py")
                file = next(file for file in files if file.is_file())
                left += {file} - found
                found.add(file)
    return sorted(path.relative_to(HOUSE).as_posix() for path in found)


def statements(node):
    """Relative imports outside blocks for type checkers."""
    if isinstance(node, ast.ImportFrom) and node.level:
        yield node
    children = node.orelse if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING" else None
    for child in ast.iter_child_nodes(node) if children is None else children:
        yield from statements(child)


@pytest.mark.exhaustive(but="device")
@pytest.mark.parametrize("roots", [COMPUTING[-2:], COMPUTING], ids=["device", "all"])
def test_the_closure_is_that_of_the_syntax_trees(roots):
    assert import_closure(roots) == closure_by_syntax_tree(roots)


STORING = {"h5py", "nibabel", "nrrd", "pydantic", "pyvista", "xxhash"}
"""Libraries that read, hand over or validate values as they are, and decide no number."""


def test_every_library_that_computing_modules_import_counts():
    text = "\n".join((HOUSE / path).read_text() for path in import_closure(COMPUTING))
    imported = {a or b for a, b in re.findall(r"^ *(?:import (\w+)|from (\w+)[\w.]* import)", text, re.MULTILINE)}
    own = {"warp-lang": "warp"}
    assert imported - STORING - sys.stdlib_module_names == {own.get(name, name) for name in LIBRARIES}


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """A copy of palpate's packages."""
    folder = tmp_path_factory.mktemp("house")
    for name in PACKAGES:
        shutil.copytree(HOUSE / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def digest_with(house, path, old, new):
    """Digest of the packages with a file edited, which is then put back."""
    file = house / path
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    try:
        return modules_digest(COMPUTING, house)
    finally:
        file.write_text(text)


UNCHANGED = [
    ("kernels/patch.py", '"""', '"""Another docstring. '),
    ("render/sweeps/make/work.py", "import contextlib\n", "import contextlib  # a comment\n\n\n"),
    ("render/sweeps/report/figure.py", "import", "x = 1\nimport"),
    ("render/sweeps/command.py", "SHOWN = 20", "SHOWN = 21"),
    ("render/cli/app.py", "import", "x = 1\nimport"),
    ("datasets/__init__.py", '    "ContourFile",\n', ""),
]
CHANGED = [
    ("kernels/patch.py", '"fuse_fp": False', '"fuse_fp": True'),
    ("render/stages/fill.py", "return ", "return 0, "),
    ("render/motions/explorations/control_points.py", "0.15", "0.25"),
    ("datasets/shapes/dog.py", "0.", "1."),
    ("device/boards/emulator/geometry.py", "0.", "1."),
    ("render/strategies/presets.py", '"', '"x'),
    ("render/sweeps/make/metrics.py", " + ", " - "),
]


def test_what_computes_nothing_changes_nothing(house):
    assert modules_digest(COMPUTING, house) == modules_digest(COMPUTING)
    for path, old, new in UNCHANGED:
        assert digest_with(house, path, old, new) == modules_digest(COMPUTING), path


def test_what_computes_changes_the_digest(house):
    for path, old, new in CHANGED:
        first = (house / path).read_text().partition('"""\n\n')[2] or (house / path).read_text()
        start = next(line for line in first.splitlines() if old in line.partition("#")[0] and '"""' not in line)
        assert digest_with(house, path, start, start.replace(old, new, 1)) != modules_digest(COMPUTING), path


def made_of(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def test_names_of_a_package_lead_to_the_modules_behind_them(tmp_path):
    house = made_of(
        tmp_path,
        {
            "render/a.py": "def f():\n    from ..datasets import (\n        Store as S,\n    )\n",
            "datasets/__init__.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n"
            "    from .store import Store\n    from .table import Table\n",
            "datasets/store.py": "import x\nif TYPE_CHECKING:\n    from .types import T\nfrom . import rows\n",
            "datasets/rows.py": "",
            "datasets/table.py": "",
            "datasets/types.py": "",
        },
    )
    assert import_closure(["render/a.py"], house) == [
        "datasets/__init__.py",
        "datasets/rows.py",
        "datasets/store.py",
        "render/a.py",
    ]


def test_a_module_that_python_refuses_counts_as_it_stands(tmp_path):
    house = made_of(tmp_path, {"render/a.py": "f((\n"})
    before = modules_digest(["render/a.py"], house)
    made_of(tmp_path, {"render/a.py": "f((  # a comment\n"})
    assert modules_digest(["render/a.py"], house) != before


def test_the_code_version_is_found_quickly():
    took = []
    for _ in range(2):
        module._read_once.cache_clear()
        start = time.process_time()
        code_version.__wrapped__()
        took.append(time.process_time() - start)
    assert min(took) < 0.25  # 0.05 s on two cores that are free; a syntax tree of each module takes 0.7 s
