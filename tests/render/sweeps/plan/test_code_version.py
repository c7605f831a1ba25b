"""The code version: the files and libraries that decide it, wherever palpate lies."""

import json
import re
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import traced_units

from palpate.render.sweeps.plan import code_version as module
from palpate.render.sweeps.plan.code_version import COMPUTING, HOUSE, LIBRARIES, code_version, files_digest

PACKAGES = ("kernels", "render", "datasets", "device")
PROVING_AND_STORING = ("datasets/contour_file/", "datasets/focus_files/", "datasets/storage/", "datasets/sweeps/",
                       "render/runtime/", "render/sweeps/plan/", "render/trust/")  # fmt: skip
"""Folders that a unit runs and that decide no number: they identify, permit, schedule and store."""


def computing_files():
    return {path.relative_to(HOUSE).as_posix() for pattern in COMPUTING for path in HOUSE.glob(pattern)}


def test_a_checkout_counts_by_its_files_and_an_installed_package_by_its_version(monkeypatch, tmp_path):
    libraries = [f"{name} {version(name)}" for name in LIBRARIES]
    assert code_version().split(", ") == [f"palpate code {files_digest(COMPUTING)}", *libraries]
    monkeypatch.setattr(module, "HOUSE", tmp_path)
    assert code_version.__wrapped__().split(", ") == [f"palpate {version('palpate')}", *libraries]


@pytest.mark.exhaustive
def test_every_module_that_runs_in_a_unit_counts(tmp_path, monkeypatch):
    """A trace of units of every kind finds no module outside COMPUTING that computes."""
    monkeypatch.setenv("PALPATE_CACHE", "off")  # meshes are repaired, not read
    command = [sys.executable, "-W", "ignore", traced_units.__file__, str(tmp_path)]
    monkeypatch.setenv("PYTHONPATH", ":".join(sys.path))
    told = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1])
    assert told["failures"] == []
    ran = {path for path in told["ran"] if path.split("/")[0] in PACKAGES}  # a virtual environment may lie beside them
    assert len(ran) > 200
    assert {path for path in ran - computing_files() if not path.startswith(PROVING_AND_STORING)} == set()


def test_every_library_that_computing_modules_import_counts():
    storing = {"h5py", "nibabel", "nrrd", "pydantic", "pyvista", "typing_extensions", "websockets", "xxhash", "usb"}
    text = "\n".join((HOUSE / path).read_text() for path in computing_files())
    imported = {a or b for a, b in re.findall(r"^ *(?:import (\w+)|from (\w+)[\w.]* import)", text, re.MULTILINE)}
    own = {"warp-lang": "warp"}
    assert imported - storing - sys.stdlib_module_names == {own.get(name, name) for name in LIBRARIES}


def made_of(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def test_the_digest_is_of_names_and_bytes_and_not_of_the_place(tmp_path):
    files = {"kernels/a.py": "x = 1\n", "kernels/in/b.py": "y = 2\n", "render/cli/c.py": "z = 3\n", "render/d.py": ""}
    house = made_of(tmp_path / "one", files)
    before = files_digest(COMPUTING, house)
    assert re.fullmatch(r"[0-9a-f]{16}", before)
    assert files_digest(COMPUTING, Path(shutil.copytree(house, tmp_path / "two"))) == before
    made_of(house, {"render/cli/c.py": "z = 4\n", "kernels/__pycache__/a.cpython-313.pyc": "1"})  # computes nothing
    assert files_digest(COMPUTING, house) == before
    changes = ({"kernels/in/b.py": "y = 2  # a comment\n"}, {"render/d.py": "\n"}, {"kernels/e.py": ""})
    assert len({before, *(files_digest(COMPUTING, made_of(house, files | own)) for own in changes)}) == 4
    (house / "kernels/e.py").rename(house / "kernels/f.py")
    assert files_digest(COMPUTING, house) not in {before, files_digest(COMPUTING, made_of(house, {"kernels/e.py": ""}))}
