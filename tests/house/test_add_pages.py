"""The patches of docs/develop/ apply to this source; with them, their tests pass and their pages' examples run."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = ["add-a-stage", "add-an-object", "add-a-hand"]
SHARED = ["tests/conftest.py", "tests/suite", "tests/cases", "tests/oracles", "pyproject.toml"]
PACKAGES = ["kernels", "render", "device", "datasets"]


def block(page, language):
    text = (ROOT / "docs" / "develop" / f"{page}.md").read_text()
    (found,) = re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return found


def patch_of(page):
    return (ROOT / "docs" / "develop" / f"{page}.diff").read_text()


def apply(diff, folder, *options):
    """git apply, which needs no repository: none is looked for above the folder."""
    if shutil.which("git") is None:
        pytest.skip("git, which applies the diffs, is not installed")
    words = ["git", "apply", *options, "-"]
    environment = os.environ | {"GIT_CEILING_DIRECTORIES": str(folder.parent)}
    done = subprocess.run(words, cwd=folder, input=diff, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def changed(diff):
    return re.findall(r"^\+\+\+ b/(.*)$", diff, re.MULTILINE)


@pytest.mark.parametrize("page", PAGES)
def test_diff_applies_to_this_source(page):
    diff = patch_of(page)
    assert any(name.startswith("tests/") for name in changed(diff))
    assert f"git apply docs/develop/{page}.diff" in (ROOT / "docs" / "develop" / f"{page}.md").read_text()
    apply(diff, ROOT, "--check")


@pytest.mark.exhaustive
@pytest.mark.parametrize("page", PAGES)
def test_diff_passes_its_tests_and_the_example_runs(page, tmp_path):
    source, names = tmp_path / "source", tmp_path / "names" / "palpate"
    names.mkdir(parents=True)
    for name in PACKAGES + SHARED:
        copy = shutil.copy2 if (ROOT / name).is_file() else shutil.copytree
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        copy(ROOT / name, source / name)
    for package in PACKAGES:
        (names / package).symlink_to(source / package)
    diff = patch_of(page)
    apply(diff, source)
    environment = os.environ | {"PYTHONPATH": str(names.parent)}
    tests = [name for name in changed(diff) if name.startswith("tests/")]
    guard = f"import palpate.render; assert palpate.render.__file__.startswith({str(names)!r})\n"
    for words in (
        [sys.executable, "-P", "-c", guard + block(page, "python no-run")],
        [sys.executable, "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider", "--device", "cpu", *tests],
    ):
        done = subprocess.run(words, cwd=source, env=environment, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
