"""What is wrong with a sweep's options is found before anything is made, and is misuse."""

import sys
from pathlib import Path

import pytest
from command_line import MISUSED, answer, refused, run

PLAN = """
[object]
source = "cube"
[motion]
duration = 0.2
seed = {seeds}
"""


@pytest.fixture
def path(tmp_path):
    return plan(tmp_path / "a.toml", [1])


def plan(path, seeds):
    path.write_text(PLAN.format(seeds=seeds))
    return path


def refused_before(store, message, *arguments):
    refused(MISUSED, message, "sweep", *arguments)
    assert not store.exists()


def made(path, *arguments):
    return answer("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure", *arguments)


def test_a_store_that_is_something_else(path, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("")
    for arguments in ([], ["--dry-run"]):
        refused(MISUSED, "not a sweep's store", "sweep", path, "--store", tmp_path / "other", *arguments)
    refused(MISUSED, "cannot be a sweep's store", "sweep", path, "--store", path)
    assert [left.name for left in (tmp_path / "other").iterdir()] == ["thesis.tex"]
    (tmp_path / "empty").mkdir()
    assert answer("sweep", path, "--dry-run", "--device", "cpu", "--store", tmp_path / "empty")["recipes_done"] == 0


def test_a_summary_that_cannot_be_written(path, tmp_path):
    for name in (".", "missing/page.md"):
        refused_before(tmp_path / "a.sweep", "must be a file in a folder", path, "--summary", tmp_path / name)
    refused_before(
        tmp_path / "a.sweep", "--summary does not go with --dry-run", path, "--summary", tmp_path / "a.md", "--dry-run"
    )


@pytest.mark.exhaustive
def test_a_baseline_that_cannot_be_updated(path, tmp_path):
    store = tmp_path / "a.sweep"
    refused_before(store, "--update-baseline needs --baseline FILE", path, "--update-baseline")
    for name in ("old", "old.xlsx", "."):
        refused_before(
            store, "must be a file that ends in .csv", path, "--baseline", tmp_path / name, "--update-baseline"
        )
    refused_before(
        store, "--update-baseline does not go with --dry-run", path, "--baseline", tmp_path / "b.csv",
        "--update-baseline", "--dry-run",
    )  # fmt: skip
    (tmp_path / "thesis.csv").write_text("year,title\n")
    refused_before(store, "is no table", path, "--baseline", tmp_path / "thesis.csv", "--update-baseline")


@pytest.mark.exhaustive
def test_a_baseline_of_another_plan(path, tmp_path):
    old = Path(made(path)["store"])
    other = plan(tmp_path / "b.toml", [7])
    refused_before(tmp_path / "b.sweep", "no recipe in common", other, "--baseline", old)
    (tmp_path / "no.csv").write_bytes(b"no table")
    refused_before(tmp_path / "b.sweep", "no.csv", other, "--baseline", tmp_path / "no.csv")


@pytest.mark.exhaustive
def test_a_recipe_in_common_is_found_far_into_a_plan_and_a_tolerance_is_of_a_metric(path, tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.render.sweeps.refusals.RECIPES_FIRST", 1)
    old = Path(made(path)["store"])
    told = made(plan(tmp_path / "c.toml", [2, 3, 1]), "--baseline", old)["comparison"]
    assert (told["kept"], told["recipe_count"]) == (True, 1)
    store = tmp_path / "b.sweep"
    refused_before(store, "no such metric", path, "--store", store, "--baseline", old, "--tolerance", "lenght_mean=1")


def test_extras_that_are_not_installed(path, tmp_path, monkeypatch):
    store = tmp_path / "a.sweep"
    for name in ("pyarrow", "distributed"):
        monkeypatch.setitem(sys.modules, name, None)
    refused_before(store, "pip install -e '.[parquet]'", path, "--table", tmp_path / "t.parquet")
    refused_before(store, "per_pose = true: Parquet needs PyArrow", path, "--set", "per_pose=true")
    refused_before(store, "pip install -e '.[cluster]'", path, "--scheduler", "local")


@pytest.mark.exhaustive
def test_tables_and_schedulers_that_cannot_be(path, tmp_path):
    pytest.importorskip("dask_jobqueue")
    store = tmp_path / "a.sweep"
    (tmp_path / "t.csv").mkdir()
    refused_before(store, "is a folder", path, "--table", tmp_path / "t.csv")
    (tmp_path / "old.csv").write_bytes(b"precious")
    refused_before(store, "old.csv: exists; --overwrite replaces it", path, "--table", tmp_path / "old.csv")
    refused_before(store, "unknown scheduler 'slrum'", path, "--scheduler", "slrum", "--workers", "2")
    refused_before(store, "unknown scheduler 'slurm'", path, "--scheduler", "slurm")
    for shard in ("5/4", "0/3", "a/b", "2"):
        refused_before(store, f"--shard must be I/N with I in 1..N, such as 2/4, not '{shard}'", path, "--shard", shard)
    for limit in ("-1", "nan"):
        refused_before(store, "--task-timeout must be at least 0 s", path, "--task-timeout", limit)
    for count in ("many", "0", "257"):
        refused_before(store, "--workers must be a number in 1..256 or auto", path, "--workers", count)
    for option in ("--baseline", "--table", "--scheduler"):
        refused_before(store, f"{option} does not go with --dry-run", path, "--dry-run", option, tmp_path / "n.csv")
    refused_before(store, "a table must end in", path, "--table", tmp_path / "t.h5")
    refused_before(store, "no device", path, "--device", "cuda:7")
    refused_before(store, "--worker-memory must be at least 0 MB", path, "--worker-memory", "-5")
    refused_before(store, "one device", path, "--scheduler", "tcp://127.0.0.1:1", "--device", "cuda:0,cuda:1")


def test_what_the_shell_took_apart_is_told_to_need_quotes(path):
    # --set motion.seed={first=1,count=5}, as bash gives it
    apart = ["--set", "motion.seed=first=1", "motion.seed=count=5"]
    refused(MISUSED, "a --set with braces or blanks needs quotes", "sweep", path, *apart)
    result = run("sweep", path, "none=such.toml")
    assert "quotes" not in result.stderr


@pytest.mark.exhaustive
def test_a_dry_run_says_that_the_run_would_be_refused(path):
    much = ["--dry-run", "--device", "cpu", "--set", "motion.seed={first=1,count=1_000_001}"]
    assert "more than 1,000,000 recipes" in answer("sweep", path, *much)["refusal"]
    assert "refused without --yes: the plan has 1,000,001 recipes" in run("sweep", path, *much).stdout
    assert answer("sweep", path, "--dry-run", "--device", "cpu")["refusal"] is None


def test_warnings_of_places_say_it_in_a_plan_s_words(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text('[object]\nsource = "cube"\nat = [0.0, 0.0, -0.2]\n[motion]\nduration = 0.1\n')
    told = run("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure").stderr
    assert "at = [0, 0, 0.2]" in " ".join(told.split())
