"""Code that data name runs only where a person said so, and is then what that person saw."""

import hashlib
import importlib.machinery
import json
import os
import stat
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from sweep_recipes import recipe_of, strategy_of, thing_of, unit_of
from typer.testing import CliRunner

from palpate.datasets import HandMotion, static_pose
from palpate.render import ImplicitObject, load_strategy
from palpate.render.cli.app import app
from palpate.render.errors import StrategyError, TrustStoreError, UntrustedCodeError
from palpate.render.strategies.intersection_strategy import IntersectionStrategy, draft_strategy
from palpate.render.sweeps.make.unit_making import make_unit
from palpate.render.sweeps.plan.loading import draft_plans, load_plans
from palpate.render.terminal.console import DONE, FAILED, MISUSED
from palpate.render.trust.accepted_code import Accepted, accept, accepted, entries, store_folder
from palpate.render.trust.permission import Code, Namer, require_permission

STAGE = """
with open({marker!r}, "a") as mark:
    mark.write("x")
from palpate.render.stages.registry import register_transform
register_transform({name!r}, lambda batch, setting: batch)
"""
BALL = """
with open({marker!r}, "a") as mark:
    mark.write("x")
import warp as wp

@wp.func
def ball(x: wp.vec3) -> float:
    return wp.length(x - wp.vec3(0.0, 0.0, 0.2)) - 0.04
"""
BOX = ["-0.05", "-0.05", "0.15", "0.05", "0.05", "0.25"]
BALL_TABLE = '[object]\nsource = "ball.py:ball"\nbounds = [-0.05, -0.05, 0.15, 0.05, 0.05, 0.25]\n'
PALPATE = [sys.executable, "-P", "-c", "from palpate.render.cli.app import main; main()"]
MOTION = '[motion]\nsource = "random"\ncount = 20\n'


@pytest.fixture
def ran(tmp_path):
    """Whether code beside the data has run: each of its files writes a mark."""
    return lambda: (tmp_path / "ran").exists()


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A strategy and an object of code, a motion, and a store of one's own."""
    name, marker = f"notes_{tmp_path.name}", str(tmp_path / "ran")
    (tmp_path / "notes.py").write_text(STAGE.format(marker=marker, name=name))
    (tmp_path / "own.json").write_text(json.dumps({"prune": ["outside"], "transform": [name], "modules": ["notes"]}))
    (tmp_path / "ball.py").write_text(BALL.format(marker=marker))
    HandMotion(None, static_pose([0, 0, 0.2]).pose).save(tmp_path / "still.csv")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)


def plan(folder, text, name="plan.toml"):
    (folder / name).write_text(text)
    return folder / name


def render(*more, thing="tube"):
    return run("render", thing, "still.csv", "-o", "out.h5", "--device", "cpu", *more)


# What is refused


def test_a_strategys_modules_are_listed_and_not_run(folder, ran):
    with pytest.raises(UntrustedCodeError) as caught:
        load_strategy("own.json")
    module = folder / "notes.py"
    digest = hashlib.sha256(module.read_bytes()).hexdigest()[:16]
    for words in (str(module), digest, "allow_code=True", "palpate trust"):
        assert words in str(caught.value)
    assert not ran()
    told = render("--strategy", "own.json")
    assert (told.exit_code, ran()) == (MISUSED, False)
    assert "notes.py" in told.stderr


def test_finding_a_module_in_a_package_imports_no_package(folder, ran, monkeypatch):
    package = folder / "path" / f"package_{folder.name}"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(f"open({str(folder / 'ran')!r}, 'a').close()\n")
    (package / "shapes.py").write_text((folder / "ball.py").read_text())
    monkeypatch.syspath_prepend(package.parent)
    with pytest.raises(UntrustedCodeError) as caught:
        IntersectionStrategy.from_json(json.dumps({"modules": [f"{package.name}.shapes"]}))
    assert "__init__.py" in str(caught.value)
    assert "shapes.py" in str(caught.value)
    text = BALL_TABLE.replace("ball.py", f"{package.name}.shapes")
    assert [code.name for code in draft_plans([plan(folder, text)]).code] == [f"{package.name}.shapes:ball"]
    assert not ran()
    assert package.name not in sys.modules


@pytest.mark.parametrize(
    "fault",
    [
        {"prune": "outside"},
        {"prune": ["outside", {"stage": "small", "length": -1}]},
        {"step": 7.0},
        {"raw": "slices", "unknown": 1},
        {"modules": ["notes", "no_such_module"]},
    ],
)
def test_a_strategy_that_is_none_runs_nothing(folder, ran, fault):
    (folder / "bad.json").write_text(json.dumps(json.loads((folder / "own.json").read_text()) | fault))
    with pytest.raises(StrategyError):
        load_strategy("bad.json", allow_code=True)
    assert not ran()


# Plans


PLANS = {
    "strategy": f'[object]\nsource = "tube"\n{MOTION}[strategy]\nsource = "own.json"\n',
    "object": BALL_TABLE + MOTION,
}


@pytest.mark.parametrize("kind", PLANS)
def test_a_plan_runs_code_with_permission_only(folder, ran, kind):
    path = plan(folder, PLANS[kind])
    with pytest.raises(UntrustedCodeError, match=r"notes\.py|ball\.py"):
        load_plans([path])
    assert (run("sweep", path, "--no-figure").exit_code, ran()) == (MISUSED, False)
    assert not draft_plans([path]).granted
    (recipe,) = load_plans([path], allow_code=True).recipes()
    assert ran()
    assert recipe.key("contours")


@pytest.mark.parametrize("kind", PLANS)
@pytest.mark.parametrize("allows", [[], ["--allow-code"]], ids=["", "allowed"])
def test_a_dry_run_never_runs_code_and_lists_it(folder, ran, kind, allows):
    done = run("sweep", plan(folder, PLANS[kind]), "--dry-run", "--device", "cpu", "--json", *allows)
    assert done.exit_code == DONE, done.output
    told = json.loads(done.stdout)
    assert (told["recipes"], told["poses"], told["families_sampled"]) == (1, 20, 0)
    assert ("notes.py" if kind == "strategy" else "ball.py") in told["code"][0]
    assert not ran()


@pytest.mark.exhaustive
def test_a_sweep_lets_its_workers_run_what_it_ran(folder, ran):
    """In processes of their own, which get the files' digests with each task."""
    path = plan(folder, BALL_TABLE + MOTION + '[strategy]\nsource = "own.json"\n')
    words = ["sweep", path, "--no-figure", "--device", "cpu", "--workers", "2", "--json"]
    done = run(*words, "--allow-code")
    assert done.exit_code == DONE, done.output
    assert json.loads(done.stdout)["poses_rendered"] == 20
    assert (folder / "ran").read_text().count("x") >= 3  # twice here, once at least in a worker


def test_a_worker_refuses_code_that_has_changed_since(folder):
    recipe = recipe_of("tube", strategy=strategy_of(folder / "own.json"))
    unit = unit_of([recipe])
    text = (folder / "notes.py").read_text()
    (folder / "notes.py").write_text(text + "\nraise SystemExit('planted')\n")
    assert "it has changed since, so it is not run" in make_unit(unit, "cpu").failed[0].message
    ball = thing_of(f"{folder / 'ball.py'}:ball", bounds=[float(x) for x in BOX])
    assert "is not the code that was permitted" in make_unit(unit_of([recipe_of(ball)]), "cpu").failed[0].message


def test_a_worker_refuses_a_package_of_which_one_file_has_changed():
    package = Code("package.shapes", (("package/__init__.py", "1" * 64), ("package/shapes.py", "2" * 64)))
    require_permission([package], frozenset({"1" * 64, "2" * 64}))
    with pytest.raises(UntrustedCodeError, match="has changed since"):
        require_permission([package], frozenset({"1" * 64, "3" * 64}))


def test_accepted_code_is_not_accepted_where_other_data_name_it():
    digests = {
        Code(name, (("ball.py", "1" * 64),), Namer("plan", text)).digest
        for name, text in (("ball.py:f", ""), ("ball.py:f", "a" * 64), ("ball.py:f", "b" * 64), ("ball.py:g", "b" * 64))
    }
    assert len(digests) == 4


# What runs, runs alone


def test_no_folder_of_data_enters_pythons_path(folder):
    module = folder / "notes.py"
    (folder / "numpy.py").write_text("raise SystemExit('planted')\n")
    (folder / "beside.py").write_text("")
    look = f"import sys\nassert not any(p in ('', {str(folder)!r}) for p in sys.path), sys.path\n"
    module.write_text(look + "import numpy\nnumpy.zeros\n" + module.read_text())
    load_strategy("own.json", allow_code=True)
    module.write_text("import beside\n" + module.read_text())
    with pytest.raises(StrategyError, match="No module named 'beside'"):
        load_strategy("own.json", allow_code=True)


def test_what_was_judged_is_what_runs(folder, monkeypatch):
    """Python's own cache of compiled files may hold anything: it is not asked."""
    cached = Path(sys.modules["importlib.util"].cache_from_source(str(folder / "notes.py")))
    cached.parent.mkdir(parents=True)  # not beside the module, if bytecode has a folder of its own
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    (folder / "evil.py").write_text("raise SystemExit('planted')\n")
    subprocess.run(
        [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "unchecked-hash", "evil.py"], check=True
    )
    next(cached.parent.glob("evil*")).rename(cached)
    assert load_strategy("own.json", allow_code=True).modules == ("notes",)


@pytest.mark.exhaustive
def test_what_shows_a_file_never_runs_code(folder, ran):
    assert render("--strategy", "own.json", "--allow-code").exit_code == DONE
    (folder / "ran").unlink()
    script = (
        "import sys; from typer.testing import CliRunner; from palpate.render.cli.app import app\n"
        "for words in (['info', 'out.h5'], ['check', 'out.h5'], ['figure', 'out.h5', '-o', 'a.png'],\n"
        "              ['play', 'out.h5', '--clock', 'virtual', '--duration', '0.1'],\n"
        "              ['export', 'out.h5', '-o', 'a.ptlist', '--duration', '0.1']):\n"
        "    done = CliRunner().invoke(app, words)\n"
        "    assert done.exit_code == 0, done.output\n"
    )
    subprocess.run([sys.executable, "-P", "-c", script], check=True)
    assert not ran()


# The store


@pytest.mark.exhaustive
@pytest.mark.parametrize("file", ["own.json", "plan.toml"])
def test_accepted_code_runs_until_anything_of_it_changes(folder, ran, file):
    plan(folder, PLANS["strategy"])
    done = run("trust", file, "--json")
    assert (done.exit_code, ran()) == (DONE, False), done.output
    (digest,) = json.loads(done.stdout)["accepted"]
    assert digest in accepted()
    assert render("--strategy", "own.json").exit_code == DONE
    assert load_plans([folder / "plan.toml"]).granted
    (folder / "other.py").write_text("")  # files beside count for nothing
    assert is_accepted(folder)
    for path in (folder / "notes.py", folder / "own.json"):
        before = path.read_text()
        path.write_text(before + "\n")
        assert not is_accepted(folder)
        assert subprocess.run(fresh_render(folder), capture_output=True).returncode == MISUSED
        path.write_text(before)
        assert is_accepted(folder)
    assert subprocess.run(fresh_render(folder), capture_output=True).returncode == DONE


def is_accepted(folder):
    return {code.digest for code in draft_strategy(str(folder / "own.json"))[1]} <= accepted()


def fresh_render(folder):
    """In a process that has imported nothing yet."""
    words = ["render", "tube", "still.csv", "-o", folder / "fresh.h5", "--strategy", "own.json", "--device", "cpu"]
    return [*PALPATE, *words]


@pytest.fixture
def archive(folder, monkeypatch):
    """Writes a package of one module, with a text, into a ZIP on Python's path."""
    path = folder / "code.zip"
    name = f"zipped_{folder.name}"

    def write(text):
        with zipfile.ZipFile(path, "w") as out:
            out.writestr(f"{name}/__init__.py", "")
            out.writestr(f"{name}/shapes.py", text)
        importlib.invalidate_caches()
        return f"{name}.shapes:ball"

    write("")
    monkeypatch.syspath_prepend(path)
    return write


def test_a_module_in_a_zip_is_accepted_as_it_is_and_no_other(folder, archive, ran):
    text = (folder / "ball.py").read_text()
    name = archive(text)
    with pytest.raises(UntrustedCodeError, match=rf"palpate trust {name}") as caught:
        ImplicitObject(name, bounds=[[-1] * 3, [1] * 3])
    assert f"shapes.py, SHA-256 {hashlib.sha256(text.encode()).hexdigest()[:16]}" in str(caught.value)
    assert run("trust", name).exit_code == DONE
    assert [Path(file).name for file in entries()[0].files] == ["__init__.py", "shapes.py"]
    archive(text.replace("0.04", "0.03"))
    with pytest.raises(UntrustedCodeError):
        ImplicitObject(name, bounds=[[-1] * 3, [1] * 3])
    assert not ran()


def test_a_module_whose_bytes_nobody_can_read_is_refused(monkeypatch):
    class Finder:
        @staticmethod
        def find_spec(name, path=None, target=None):
            return importlib.machinery.ModuleSpec(name, Finder, origin="afar") if name == "remote_shapes" else None

    monkeypatch.setattr(sys, "meta_path", [Finder, *sys.meta_path])
    with pytest.raises(StrategyError, match="comes from afar, which cannot be read"):
        IntersectionStrategy.from_json('{"modules": ["remote_shapes"]}', allow_code=True)


def test_what_is_accepted_is_listed_and_can_be_taken_back(folder):
    assert run("trust", "own.json", "ball.py").exit_code == DONE
    assert sorted(entry.name for entry in entries()) == ["ball.py", "notes"]
    listed = run("trust")
    assert "notes.py" in listed.stdout
    assert "own.json" in listed.stdout
    assert run("trust", "--remove", "own.json").exit_code == DONE
    (left,) = entries()
    assert run("trust", "--remove", left.digest[:12]).exit_code == DONE
    assert accepted() == frozenset()
    assert run("trust", "--remove", "own.json").exit_code == MISUSED
    with pytest.raises(UntrustedCodeError):
        load_strategy("own.json")


@pytest.mark.parametrize("file", ["no_such.json", "still.csv", "plain.json"])
def test_what_names_no_code_is_not_accepted(folder, file):
    (folder / "plain.json").write_text('{"prune": ["outside"]}')
    assert run("trust", file).exit_code == MISUSED
    assert not accepted()


def entry(digest):
    return Accepted(digest, "name", "", (), "2025-01-01")


def test_the_store_is_its_owners_alone(folder):
    os.umask(before := os.umask(0))
    try:
        os.umask(0)
        accept(entry("0" * 64))
    finally:
        os.umask(before)
    store = store_folder()
    assert store == folder / "config" / "palpate" / "trust"
    for path, mode in ((store.parent, 0o700), (store, 0o700), (store / ("0" * 64), 0o600)):
        assert stat.S_IMODE(path.stat().st_mode) == mode
    assert [path.name for path in store.iterdir()] == ["0" * 64]
    store.chmod(0o770)
    for action in (accepted, entries, lambda: accept(entry("1" * 64))):
        with pytest.raises(TrustStoreError, match="nobody else can write"):
            action()
    assert run("trust").exit_code == FAILED


def test_links_are_no_entries_and_no_store(folder):
    accept(entry("0" * 64))
    store = store_folder()
    (store / ("1" * 64)).symlink_to(folder / "ball.py")
    (store / "note").write_text("")
    assert accepted() == {"0" * 64}
    store.rename(folder / "elsewhere")
    store.symlink_to(folder / "elsewhere")
    with pytest.raises(TrustStoreError):
        accepted()


def test_a_relative_config_folder_is_ignored(monkeypatch, folder):
    monkeypatch.setenv("XDG_CONFIG_HOME", "here")
    monkeypatch.setenv("HOME", str(folder / "home"))
    assert store_folder() == folder / "home" / ".config" / "palpate" / "trust"
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # a user without a home folder
    with pytest.raises(TrustStoreError, match="no home folder"):
        accepted()


@pytest.mark.exhaustive
def test_code_given_as_an_object_needs_no_permission(folder):
    """A stage that a script has registered is no code from data, though data name it."""
    script = (
        "import notes\nfrom palpate.render import load_strategy\nfrom pathlib import Path\n"
        "assert load_strategy('own.json').modules == ('notes',)\n"  # imported already: nothing runs
        "Path('bare.json').write_text(Path('own.json').read_text().replace(', \"modules\": [\"notes\"]', ''))\n"
        "load_strategy('bare.json')\n"
    )
    (folder / "script.py").write_text(script)
    done = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (folder / "ran").read_text() == "x"


def test_modules_of_python_itself_need_permission_too():
    """`antigravity` opens a browser when it is imported."""
    with pytest.raises(UntrustedCodeError, match=r"antigravity \("):
        IntersectionStrategy.from_json('{"modules": ["antigravity"]}')
    assert "antigravity" not in sys.modules
