"""The house: which package may import which, what is packed, how large files and kernels may grow."""

import ast
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from importlib.metadata import files, version
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("kernels", "render", "device", "datasets")
ALLOWED = {"kernels": set(), "datasets": set(), "device": set(), "render": {"kernels", "datasets", "device"}}
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).glob("*.py"))


def imports_of(path):
    """Packages of the house, and modules of others, that a file imports."""
    own, other = set(), set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == 2:
            own.add(node.module.split(".")[0])
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            other.add(node.module.split(".")[0])
        elif isinstance(node, ast.Import):
            other.update(name.name.split(".")[0] for name in node.names)
    return own, other


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("path", SOURCES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_arrows_point_one_way(path):
    own, other = imports_of(path)
    assert own <= ALLOWED[path.parent.name]
    assert "palpate" not in other  # siblings are imported relatively
    if path.parent.name in ("device", "datasets"):
        assert "warp" not in other
    if path.parent.name == "kernels":
        assert not other & {"h5py", "usb", "trimesh"}


def test_folders_are_flat_and_have_no_room_for_odds_and_ends():
    for package in PACKAGES:
        inside = [p for p in (ROOT / package).iterdir() if p.is_dir() and p.name != "__pycache__"]
        assert inside == []
    assert not [p for p in SOURCES if re.search(r"util|common|helper|manager|misc", p.stem)]
    assert not (ROOT / "palpate").exists()  # it would hide the namespace


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("path", SOURCES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_files_and_kernels_stay_small(path):
    text = path.read_text()
    assert text.count("\n") <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and any("wp.kernel" in ast.unparse(d) for d in node.decorator_list):
            assert node.end_lineno - node.lineno <= 65, node.name
            assert len(node.args.args) <= 16, node.name
            assert node.name.startswith("_"), node.name
            assert ast.get_docstring(node), node.name
            signature = "\n".join(text.splitlines()[node.lineno - 1 : node.body[0].lineno])
            assert "# In:" in signature, node.name
            assert "# Out:" in signature, node.name


@pytest.mark.parametrize("path", [p for p in SOURCES if p.parent.name == "kernels"], ids=lambda p: p.name)
def test_kernel_modules_are_compiled_exactly(path):
    text = path.read_text()
    assert ("@wp.kernel\n" not in text) or ("wp.set_module_options(EXACT)" in text)
    decorators = {line.strip() for line in text.splitlines() if line.strip().startswith("@wp.kernel")}
    assert decorators <= {"@wp.kernel", "@wp.kernel(**MODULE)"}


def test_precompiling_covers_every_kernel_module():
    from palpate.kernels import STAGES

    assert {p.stem for p in SOURCES if "@wp.kernel\n" in p.read_text()} == set(STAGES)


@pytest.mark.parametrize("package", PACKAGES)
def test_each_package_has_the_version_of_the_project(package):
    module = import_module(f"palpate.{package}")
    assert module.__version__ == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    with pytest.raises(AttributeError, match=f"module 'palpate.{package}' has no attribute 'nothing'"):
        _ = module.nothing


@pytest.mark.parametrize("package", ["kernels", "render"])
def test_a_package_that_imports_little_does_not_read_the_metadata_until_asked(package):
    """Reading them takes some ten times as long as importing these two."""
    code = (
        f"import sys, palpate.{package} as p; early = 'importlib.metadata' in sys.modules; print(early, p.__version__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", version("palpate")]


def test_the_installed_package_has_every_module():
    assert version("palpate")
    listed = [str(f) for f in files("palpate") or []]
    if any("__editable__" in name for name in listed):
        return  # an editable install serves this very tree
    for path in SOURCES:
        assert f"palpate/{path.parent.name}/{path.name}" in listed
    for package in PACKAGES:
        assert f"palpate/{package}/py.typed" in listed
    assert not [name for name in listed if name.startswith(("tests", "palpate/tests"))]


def test_readme_is_short_and_its_commands_are_those_that_ci_runs():
    readme = (ROOT / "README.md").read_text()
    assert readme.count("\n") <= 150
    commands = re.findall(r"^(?:    |)(python3 -m venv .*)$", readme, re.MULTILINE)
    assert len(commands) == 2
    ci = (ROOT / ".ci" / "run").read_text()
    assert "README.md" in ci  # it takes the command from there


def test_what_scripts_import_is_found_under_its_name_whatever_was_imported_before():
    import palpate.render as pipeline

    assert sorted(pipeline.__all__) == sorted(pipeline._HOMES)
    rooms = {path.stem for path in (ROOT / "render").glob("*.py")}
    assert not rooms & set(pipeline.__all__)  # importing a room of that name would hide it
    for name in pipeline.__all__:
        assert getattr(pipeline, name) is getattr(import_module(f"palpate.render.{pipeline._HOMES[name]}"), name)
    with pytest.raises(AttributeError, match="nothing"):
        _ = pipeline.nothing
