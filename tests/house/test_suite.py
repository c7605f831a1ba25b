"""How tests are run: those that a change reaches, a budget, CPU seconds, workers that collect from both ends."""

import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
import reach
from rooms import ROOT, digests, imported_rooms, importers, public_homes

SUITE = ROOT / "tests" / "suite"


def run_tests(folder, *words, plugins=("cpu_time", "reach")):
    """Exit code and output of pytest with these plugins on the tests of a folder."""
    (folder / "pytest.ini").write_text(f"[pytest]\npythonpath = {SUITE}\nmarkers =\n    exhaustive\n", encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", str(folder / "pytest.ini")]
    command += [word for plugin in plugins for word in ("-p", plugin)]
    done = subprocess.run([*command, *words, str(folder)], cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def write_test(folder, text):
    (folder / "test_given.py").write_text(textwrap.dedent(text))


def test_a_public_name_belongs_to_the_room_that_defines_it():
    assert public_homes()["render"]["closed_contour"] == "render/strategies"
    assert public_homes()["render"]["HandMotion"] == public_homes()["datasets"]["HandMotion"] == "datasets/motions"
    assert {room for homes in public_homes().values() for room in homes.values()} <= digests().keys()


def test_arrows_are_turned_round():
    assert {"render/playback", "render/cli"} <= importers()["render/sampling"]
    assert "render/cli" in importers()["device/playing"]  # across packages
    assert "device/boards" not in importers().get("device/playing", set())
    assert "device" in importers()["device/boards"]  # by text


def test_a_test_file_uses_the_rooms_that_it_imports_or_names(tmp_path):
    file = tmp_path / "test_it.py"
    file.write_text(
        "from palpate.render import (\n    MeshObject,\n    open_contour,\n)\n"
        "from palpate.device.playing.player import Player\nCODE = 'import palpate.kernels.section.join'\n"
    )
    assert imported_rooms(file) >= {"render/objects/mesh", "render/strategies", "device/playing", "kernels/section"}
    assert "render/sampling" not in imported_rooms(file)


@pytest.mark.parametrize(
    ("changed", "file", "rank"),
    [
        ({"render/sampling"}, "tests/render/sampling/test_orders.py", 0),
        ({"tests/render/sampling"}, "tests/render/sampling/test_orders.py", 0),
        ({"render/sampling"}, "tests/render/playback/test_drive.py", 1),
        ({"tests/oracles"}, "tests/kernels/test_geometry.py", 2),
        ({"benchmarks"}, "tests/house/test_benchmarks.py", 2),
        ({"docs/guide"}, "tests/house/test_docs.py", 2),
        ({".ci"}, "tests/render/sweeps/test_docs.py", 2),
        ({"README.md"}, "tests/house/test_rooms.py", 2),
        ({"datasets/motions"}, "tests/render/sampling/test_hops.py", 1),
        ({"datasets/contour_file"}, "tests/faults/test_fuzz.py", 2),  # by what it shares with others
        ({"device/playing"}, "tests/kernels/test_geometry.py", None),
        ({"docs/guide"}, "tests/kernels/test_geometry.py", None),
        (set(), "tests/render/sampling/test_orders.py", None),
    ],
)
def test_a_change_reaches_its_room_those_that_import_it_and_tests_that_name_it(changed, file, rank):
    assert reach.rank_of(ROOT / file, changed) == rank


@pytest.mark.parametrize("room", ["pyproject.toml", "tests", "tests/suite"])
def test_what_every_test_runs_with_reaches_every_test(room):
    assert reach.reaches_all({room, "docs"})
    assert not reach.reaches_all({"render/cli", "docs"})


def test_a_digest_changes_with_a_files_content_and_name(tmp_path, monkeypatch):
    monkeypatch.setattr("rooms.ROOT", tmp_path)
    (tmp_path / "kernels" / "__pycache__").mkdir(parents=True)
    (tmp_path / ".ci").mkdir()
    (tmp_path / ".gitignore").write_text("site/\n")
    seen = []
    for name, content in [("a.py", "x"), ("a.py", "y"), ("b.py", "y"), ("__pycache__/b.pyc", "z")]:
        (tmp_path / "kernels" / name).write_text(content)
        (tmp_path / ".ci" / "proved").write_text(content)
        seen.append(digests.__wrapped__().get("kernels"))
    assert len(set(seen)) == 3  # bytecode does not count
    assert seen[2] == seen[3]
    (tmp_path / "kernels" / "site").mkdir()
    for stray in ("dog.h5", "kernels/site/page.html", ".ci/proved"):
        (tmp_path / stray).write_text("x")
    assert digests.__wrapped__().keys() == {"kernels"}  # nor do what git ignores, what lies at the root, and .ci/proved


def test_what_was_proved_is_read_back_and_a_wrong_file_proves_nothing(tmp_path):
    file = tmp_path / "proved"
    assert reach.proved_digests(file) == {}
    file.write_text(reach.proved_text())
    assert reach.proved_digests(file) == digests()
    assert reach.changed_rooms(reach.proved_digests(file), digests()) == set()
    file.write_bytes(b"\xff\xfe nothing\n")
    assert reach.proved_digests(file) == {}
    assert "render/sampling" in reach.changed_rooms({}, digests())


@pytest.mark.exhaustive
def test_the_budget_leaves_out_by_name_what_would_begin_too_late(tmp_path):
    write_test(
        tmp_path,
        """
        import time, pytest
        def test_first():
            time.sleep(0.3)
        @pytest.mark.parametrize("case", range(3))
        def test_second(case):
            assert True
        """,
    )
    code, text = run_tests(tmp_path, "--budget", "0.2")
    assert code == 0
    assert "test_given.py::test_second (3)\n3 tests left out" in text
    assert "test_first" not in text.partition("left out by the budget")[2]
    code, text = run_tests(tmp_path, "--budget", "100")
    assert "left out" not in text
    code, text = run_tests(tmp_path, "--budget", "0")
    assert code != 0
    assert "--budget must be above 0 s, not 0" in text


BUSY = """
    import pytest, time
    def use(seconds):
        begin = time.process_time()
        while time.process_time() - begin < seconds:
            pass
    @pytest.fixture(scope="module")
    def shared():
        use(0.6)
    once = []
    def test_pays_for_an_import():
        if not once:
            use(0.6)
        once.append(1)
    def test_pays_for_what_others_share(shared):
        pass
    @pytest.mark.exhaustive
    def test_may_be_slow():
        use(0.6)
"""


@pytest.mark.exhaustive
def test_a_quick_test_over_the_bound_fails_and_only_that(tmp_path):
    write_test(tmp_path, BUSY)
    code, text = run_tests(tmp_path, "--cpu-most", "0.3")
    assert code == 0, text
    write_test(tmp_path, BUSY + "    def test_is_slow():\n        use(0.9)\n")
    assert run_tests(tmp_path)[0] == 0  # without the bound
    code, text = run_tests(tmp_path, "--cpu-most", "0.7")
    assert code == 0  # 0.9 s are over the bound of 0.7, but within its noise
    assert "test_is_slow: used 0.9" in text
    code, text = run_tests(tmp_path, "--cpu-most", "0.3")
    assert code == 1
    assert "1 failed, 3 passed" in text
    assert "mark it exhaustive" in text
    code, text = run_tests(tmp_path, "--cpu-most", "0.3", "-n", "2")
    assert code == 1
    assert "1 failed, 3 passed" in text


@pytest.mark.exhaustive
def test_a_childs_seconds_count(tmp_path):
    write_test(
        tmp_path,
        """
        import subprocess, sys
        def test_starts_a_process():
            subprocess.run([sys.executable, "-c", "for k in range(30_000_000): pass"], check=True)
        """,
    )
    code, text = run_tests(tmp_path, "--cpu-most", "0.3")
    assert code == 1
    assert "mark it exhaustive" in text


@pytest.mark.exhaustive
@pytest.mark.parametrize("workers", ["0", "2"])
def test_a_run_over_the_sum_fails_and_says_so(tmp_path, workers):
    write_test(tmp_path, BUSY)
    code, text = run_tests(tmp_path, "--cpu-sum", "0.5", "-n", workers)
    assert code == 1
    assert "over the bound of" in text
    assert "3 passed" in text
    code, text = run_tests(tmp_path, "--cpu-sum", "100", "-n", workers)
    assert code == 0


def blocks_before(patch):
    """Each file that a patch changes, and the lines that it expects there, block by block."""
    for part in patch.split("\ndiff --git ")[1:]:
        name = re.search(r"^\+\+\+ b/(.+)$", part, re.MULTILINE)[1]
        for block in re.split(r"^@@ .* @@.*\n", part, flags=re.MULTILINE)[1:]:
            yield name, "".join(line[1:] + "\n" for line in block.splitlines() if line[:1] in " -")


def test_every_mutant_fits_the_source_and_names_tests_that_are_there():
    patches = sorted((ROOT / "tests" / "mutants").rglob("*.patch"))
    assert len(patches) > 400
    for path in patches:
        text = path.read_text()
        for name, before in blocks_before(text):
            assert before in (ROOT / name).read_text(), path
        (tests,) = re.findall(r"^Tests: (.+)$", text, re.MULTILINE)
        assert all((ROOT / test.partition("::")[0]).exists() for test in tests.split()), path


def test_a_calibration_takes_cpu_time():
    import cpu_time

    assert 0 < cpu_time.calibrate() < 100 * cpu_time.CALIBRATION


@pytest.mark.exhaustive
def test_two_workers_collect_from_both_ends_and_agree(tmp_path):
    for folder in ("b", "a"):
        for name in ("test_two", "test_one"):
            (tmp_path / folder).mkdir(exist_ok=True)
            (tmp_path / folder / f"{name}_{folder}.py").write_text(
                f"import os, pathlib\nlog = pathlib.Path({str(tmp_path)!r}, os.environ['PYTEST_XDIST_WORKER'])\n"
                "log.open('a').write(__name__ + ' ')\ndef test_it():\n    pass\n"
            )
    (tmp_path / "conftest.py").write_text(
        "pytest_plugins = ['first_minute']\ndef pytest_addoption(parser):\n"
        "    parser.addoption('--device', action='append')\n    parser.addoption('--lanes')\n"
    )
    code, text = run_tests(tmp_path, "-n", "2", plugins=())
    assert code == 0, text
    assert "4 passed" in text
    orders = [Path(tmp_path, worker).read_text().split() for worker in ("gw0", "gw1")]
    assert orders[0] == orders[1][::-1]
