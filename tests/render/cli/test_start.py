"""What the command line imports before it answers: help takes no library that computes."""

import subprocess
import sys

import pytest

HEAVY = {"numpy", "scipy", "warp", "h5py", "trimesh", "matplotlib", "pydantic", "usb", "rich.progress"}
SCRIPT = """
import sys
from palpate.render.cli.app import exit_code
sys.argv[1:] = {words!r}
exit_code()
print(*sys.modules, file=sys.stderr)
"""


def imported(*words):
    done = subprocess.run(
        [sys.executable, "-P", "-c", SCRIPT.format(words=list(words))], capture_output=True, text=True, check=True
    )
    assert done.stdout
    return set(done.stderr.split())


@pytest.mark.exhaustive
@pytest.mark.parametrize("words", [["--help"], ["sweep", "--help"], ["sweep", "status", "--help"]])
def test_help_imports_nothing_that_computes(words):
    assert imported(*words) & HEAVY == set()


@pytest.mark.exhaustive
def test_the_check_sees_what_is_imported():
    assert "numpy" in imported("sampling", "--json")
