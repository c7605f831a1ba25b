"""The committed script and style are what their source gives: `npm ci && npm run build`."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[4] / "render/view/page"
WEB, ASSETS = PAGE / "web", PAGE / "assets"


def test_packages_have_exact_versions_and_digests():
    package = json.loads((WEB / "package.json").read_text())
    assert all(
        re.fullmatch(r"\d+\.\d+\.\d+", v)
        for v in [*package["dependencies"].values(), *package["devDependencies"].values()]
    )
    locked = json.loads((WEB / "package-lock.json").read_text())["packages"]
    assert all(entry["integrity"].startswith("sha512-") for name, entry in locked.items() if name)


@pytest.mark.exhaustive
def test_a_rebuild_gives_the_same_bytes(tmp_path):
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed: the page's script is not rebuilt")
    copy = tmp_path / "page/web"
    shutil.copytree(WEB, copy, ignore=shutil.ignore_patterns("node_modules"))
    (tmp_path / "page/assets").mkdir()
    done = subprocess.run(
        ["npm", "ci", "--no-audit", "--no-fund"], cwd=copy, capture_output=True, text=True, timeout=300
    )
    if done.returncode and re.search(r"ENOTFOUND|EAI_AGAIN|ECONNREFUSED|ETIMEDOUT|ENETUNREACH|network", done.stderr):
        pytest.skip(f"npm reaches no registry: the page's script is not rebuilt ({done.stderr.strip()[:200]})")
    assert done.returncode == 0, done.stderr
    subprocess.run(["npm", "run", "build"], cwd=copy, check=True, capture_output=True, timeout=120)
    made = {path.name: path.read_bytes() for path in (tmp_path / "page/assets").iterdir()}
    assert made == {path.name: path.read_bytes() for path in ASSETS.iterdir()}
