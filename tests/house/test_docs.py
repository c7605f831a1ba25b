"""Every block of code of the documents runs as it stands: commands, then Python; data are loaded as what they show."""

import ast
import json
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from page_blocks import PAGES, ROOT, blocks_of, command_lines, spans_of
from page_run import fill, fill_inputs, run_page, write_named_blocks
from typer.main import get_command

from palpate.datasets import load_recording, read_ptlist
from palpate.datasets.errors import RecordingError
from palpate.render import RenderedBatch, load_plans, load_rig, load_strategy
from palpate.render.cli.app import app
from palpate.render.sampling.presets import load_sampling
from palpate.render.study.plan.study_reading import read_study

README = ROOT / "README.md"
NO_RUN = {  # pages with blocks that are marked `no-run`, and what runs them instead
    "docs/develop/add-a-hand.md": "test_add_pages.py, with the page's own change of the source",
    "docs/develop/add-a-stage.md": "the same",
    "docs/develop/add-an-object.md": "the same",
    "docs/formats/exports.md": "tests/render/exports/test_vtkhdf.py, where PyVista is installed",
    "docs/formats/study-analysis.md": "tests/render/study/test_analysis_page.py, with a table of the plan",
}
NOT_HERE = {  # command lines that no test runs, and why
    r"^(python3 -m venv|pip install|apt-get)": "changes the machine; .ci/run runs README's two",
    r"^(pytest|ruff|pyright|tests/)": "is how this project is tested",
    r"npm ci": "tests/render/view/page/test_bundle.py runs it, where npm reaches its registry",
    r"^(dask |CUDA_VISIBLE)": "is a program of Dask that does not end by itself",
    r"--device cuda": "needs a GPU",
    r"--scheduler": "needs a cluster of Dask; the page's Python makes the same with one of its own",
    r"^palpate bench": "takes half a minute; tests/render/bench/ runs it small",
    r"^python benchmarks/": "takes minutes; tests/house/test_bench_peers.py runs it small",
    r"^(cmake|palpate-ultraleap)": "needs a vendor's SDK; tests/device/bridges/ compiles and runs it with a stub",
}
COLUMN = 88  # characters of a line of code
FEW = "--set motion.duration=1.0 --set motion.seed=1 --set object.source=tube"
ELSEWHERE = {  # what stands in a page -> what stands for it on this machine
    r"^python3 -m venv .* && \.venv/bin/(palpate demo)": r"\1 --clock virtual",
    r"(palpate sweep (?:objects|study)\.toml)": rf"\1 {FEW}",  # seconds instead of a minute
}
REFUSED = {
    "--same-results": 2,  # there are no results of another code version, as the page says
    "--source ultraleap": 1,  # there is no tracking service, so no pose could be drawn
}


def here(line, folder):
    """The command as it runs here, without a board and in no real time, and its exit code; None if it does not."""
    line = re.sub(r"\s+#.*", "", line)
    for pattern, instead in ELSEWHERE.items():
        line = re.sub(pattern, instead.replace("FOLDER", str(folder)), line)
    if any(re.search(pattern, line) for pattern in NOT_HERE):
        return None
    if line.startswith("palpate view") and "--export" not in line:  # Ctrl-C, which ends it well
        line = f"python -m interrupted_command {line}" + " --no-browser" * ("--no-browser" not in line)
    if re.match(r"palpate study (?!analyse|example)", line) and "--dry-run" not in line:  # whose participant answers
        line = f"python -m answered_study {line}" + " --no-browser" * ("--no-browser" not in line)
    if line.startswith("palpate live"):
        line = re.sub(r"--duration \d+", "--duration 2", line) + " --no-browser" * ("--view" in line)
    if "--array stratos" in line and "--emulate" not in line:
        line += " --emulate"
    if line.startswith("palpate selftest"):
        line += " --clock virtual"
    if line.startswith("palpate play"):
        if "--array pat16" in line and "--emulate" not in line:
            line = line.replace(" --watchdog", "") + " --emulate"  # which guards real boards
        line += " --clock virtual" * ("--clock" not in line)
    if line.startswith("palpate prepare") or (line.startswith("palpate play") and "frames.h5" not in line):
        line += " --duration 2" * ("--duration" not in line)  # of the playback
    return line, max(code if option in line else 0 for option, code in REFUSED.items())


def has_python(page):
    return any(block.language == "python" and "no-run" not in block.marks for block in blocks_of(page))


RUN = [page for page in PAGES if has_python(page) or any(here(line, ROOT) for line in command_lines(page))]


@pytest.mark.exhaustive
@pytest.mark.parametrize("page", RUN, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_and_python_of_a_page_run(page, tmp_path):
    """From top to bottom, in a folder with the page's own files and those that it takes for granted."""
    if page != README:  # a newcomer has no files
        fill(tmp_path)
    write_named_blocks(page, tmp_path)
    run_page(page, tmp_path, here)


def test_the_readmes_python_is_a_page_that_a_newcomer_can_guess_and_runs(tmp_path, monkeypatch, capsys):
    """At most twelve lines, names of one module, and nothing of Warp. A shorter motion is rendered and not drawn."""
    (code,) = [block.text for block in blocks_of(README) if block.language == "python"]
    assert len(code.splitlines()) <= 12
    assert re.findall(r"^(?:from|import) .*", code, re.MULTILINE) == [code.splitlines()[0]]
    assert code.startswith("from palpate.render import ")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(RenderedBatch, "figure", lambda batch, path, **options: Path(path).touch())
    exec(code.replace("duration=3.0", "duration=1.0"), {})
    said = capsys.readouterr().out
    assert [line.split("(")[0] for line in said.splitlines()] == ["RenderedBatch", "SampledContours", "Playback"]
    assert {"short.h5", "tube.png"} == {path.name for path in tmp_path.iterdir()}


@pytest.mark.exhaustive
def test_the_readmes_python_warns_of_nothing(tmp_path):
    _, warned = run_page(README, tmp_path, lambda line, folder: None)
    assert warned == ""
    assert {"short.h5", "tube.png"} <= {path.name for path in tmp_path.iterdir()}


def test_blocks_fit_their_column():
    """A reader of the site sees some 90 characters of a line. .ci/run takes README's command of tests as one line."""
    wide = [
        f"{block.page.relative_to(ROOT)}: {line}"
        for page in PAGES
        for block in blocks_of(page)
        for line in block.text.splitlines()
        if len(line) > COLUMN
    ]
    assert [line for line in wide if not line.startswith("README.md: python3 -m venv")] == []


def test_pages_import_names_that_there_are():
    """What their Python does with these names is seen when it runs (`test_commands_and_python_of_a_page_run`)."""
    count = 0
    for block in (block for page in PAGES for block in blocks_of(page)):
        if block.language != "python" or "no-run" in block.marks:
            continue
        for node in ast.walk(ast.parse(block.text)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("palpate."):
                module = import_module(node.module)
                assert [name.name for name in node.names if not hasattr(module, name.name)] == [], block.place
                count += len(node.names)
    assert count > 30


def test_blocks_that_do_not_run_are_those_that_are_argued():
    marked = {str(b.page.relative_to(ROOT)) for page in PAGES for b in blocks_of(page) if "no-run" in b.marks}
    assert marked == set(NO_RUN)
    lines = [line.strip() for page in PAGES for line in command_lines(page)]
    assert [pattern for pattern in NOT_HERE if not any(re.search(pattern, line) for line in lines)] == []


# Data


def load_json(value, path):
    """What a JSON file is, by its keys; loading raises where it is refused."""
    if isinstance(value, list):
        return load_rig(str(path))
    keys = set(value)
    if keys == {"position", "orientation"} or keys == {"matrix"}:
        return load_recording(path.parent / "hand.json", alignment=path)
    if "frames" in keys:
        return load_recording(path)
    if "modules" in keys:  # whose stages no other test of this process should know
        code = f"from palpate.render import load_strategy; load_strategy({str(path)!r}, allow_code=True)"
        return subprocess.run([sys.executable, "-c", code], check=True)
    if keys & {"prune", "transform", "raw"}:
        return load_strategy(str(path))
    assert keys & {"speed", "pace", "gap"}, f"no loader is known for JSON with {sorted(keys)}"
    return load_sampling(str(path))


def load(block, folder):
    """Load a block of data as palpate does; raises where palpate refuses it."""
    path = folder / (block.name or f"block.{block.language}")
    path.parent.mkdir(exist_ok=True)
    path.write_text(block.text)
    if path.suffix == ".toml":
        return read_study(path) if "[[block]]" in block.text else load_plans([path])
    return load_json(json.loads(block.text), path) if path.suffix == ".json" else read_ptlist(path)


def is_data(block):
    return block.language in ("json", "toml") or Path(block.name or "").suffix in (".json", ".toml", ".ptlist")


DATA = [block for page in PAGES for block in blocks_of(page) if is_data(block)]
SLOW = [pytest.mark.exhaustive]  # a strategy that names a module is loaded by a process of its own


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    """A folder with a reader's files."""
    folder = tmp_path_factory.mktemp("reader")
    fill_inputs(folder)
    return folder


@pytest.mark.filterwarnings("ignore:the hand is nowhere in front of the array")  # one frame, without an alignment
@pytest.mark.parametrize(
    "block", [pytest.param(b, id=b.place, marks=SLOW if '"modules"' in b.text else []) for b in DATA]
)
def test_data_of_a_page_is_what_palpate_loads(block, reader):
    for other in blocks_of(block.page):
        if "\nregister_" in other.text:  # the module of a strategy that names one
            (reader / "my_stages.py").write_text(other.text)
    assert load(block, reader) is not None


def test_a_broken_example_would_be_found(reader):
    """Such as a recording whose fields are left out, as this project's own pages once had them."""
    (block,) = [block for block in DATA if '"wrist": null, ' in block.text]
    with pytest.raises(RecordingError, match="wrist"):
        load(block._replace(text=block.text.replace('"wrist": null, ', "")), reader)


# Words in the text

FORMATS = {"contours", "table", "recipe", "code"}  # `palpate table 1`: a file's format, and no command


def known_options():
    """Names of commands -> their options."""
    found = {"help": set()}
    for name, command in get_command(app).commands.items():
        parts = command.commands if hasattr(command, "commands") else {"": command}
        found[name] = {option for part in parts.values() for own in part.params for option in own.opts} | {"--help"}
    return found


def test_commands_in_the_text_have_names_and_options_that_there_are():
    known, wrong, count = known_options(), [], 0
    for page in PAGES:
        for text in [*spans_of(page), *command_lines(page)]:
            for name, rest in re.findall(r"(?:^|&& )\s*palpate ([a-z]+)([^#&]*)", text):
                count += 1
                if name not in FORMATS and (
                    name not in known or set(re.findall(r"(?<=\s)--[a-z-]+", rest)) - known[name]
                ):
                    wrong.append(f"{page.name}: palpate {name}{rest}")
    assert wrong == []
    assert count > 100


def test_what_a_shell_would_take_apart_is_quoted():
    for path in [README, *(ROOT / "docs").rglob("*.md"), *(ROOT / "render").rglob("*.py")]:
        assert not re.findall(r"--set [\w.]+=[^\s`'\"]*[{\[].*", path.read_text()), path.name


def test_what_needs_a_board_is_not_in_a_block_to_copy():
    copied = [line for line in command_lines(README) if line.startswith("palpate")]
    assert copied
    assert not [line for line in copied if "--calibration" in line]
