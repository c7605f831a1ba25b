"""The house's rooms: which folder may import which, how many modules it holds, how large files and kernels may grow."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter, defaultdict
from functools import cache
from importlib import import_module
from importlib.metadata import files, version

import pytest
from rooms import BY_TEXT, PACKAGES, ROOT, SOURCES, folder_of, imports_of, is_init, tree_of

ALLOWED = {"kernels": set(), "datasets": set(), "device": set(), "render": {"kernels", "datasets", "device"}}
MODULES_MOST = 20
SHARED = {"Box", "Chunk", "Field", "Frame", "Lattice", "Surface"}
"""Class names that still stand in two folders, each a term of both fields; no name may join them."""
JSON_UNBOUNDED = {
    "datasets/json_text.py": "the reader itself",
    "device/live/writer_handle.py": "a message of palpate's own process",
    "device/live/writer_process.py": "a message of palpate's own process, and the file that it names",
    "device/playing/watchdog.py": "the one argument that palpate's own process is started with",
    "device/playing/limits.py": "a package that imports no other; it bounds depth and digits itself",
    "render/live/drawing_run.py": "a message of palpate's own process",
    "render/live/renderer_process.py": "a message of palpate's own process",
    "render/live/spool.py": "what it wrote to a text in the same line",
    "render/study/run/study_file.py": "what it wrote to a text in the line before",
    "render/sweeps/make/rendering.py": "parts of a recipe that it wrote to texts after reading it",
}
"""Modules that parse JSON without `datasets.json_text`, which bounds it, with the reason."""
ROW = re.compile(r"^\| `([a-z_0-9/]+)` \| (\d+) \| [^|]+ \| ([^|]*) \|$", re.MULTILINE)


@cache
def arrows():
    """Folders of the same package that the files of each folder import; what an `__init__` re-exports is no arrow."""
    found = defaultdict(set)
    for path in SOURCES:
        package = path.relative_to(ROOT).parts[0]
        for target in () if is_init(path) else imports_of(path)[0]:
            folder = folder_of(target)
            if folder.split("/")[0] == package and folder != folder_of(path):
                found[folder_of(path)].add("root" if folder == package else folder.removeprefix(f"{package}/"))
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_arrows_are_those_of_the_table_and_point_up(package):
    page = (ROOT / "docs/develop/architecture.md").read_text()
    rows = [row for row in ROW.findall(page) if row[0].split("/")[0] == package]
    folders = {folder_of(path) for path in SOURCES if folder_of(path).split("/")[0] == package}
    assert {name for name, _, _ in rows} == folders
    found, above = arrows(), set()
    for name, count, imports in rows:
        listed = set(imports.split(", ")) if imports.strip() else set()
        assert listed == found[name], (name, sorted(found[name]))
        assert listed <= above, (name, sorted(listed - above))
        assert int(count) == sum(folder_of(path) == name and not is_init(path) for path in SOURCES), name
        above.add("root" if name == package else name.removeprefix(f"{package}/"))


def circles(imports):
    """Groups of files that reach themselves through what they import: strongly connected components (Tarjan 1972)."""
    number, low, open_files, found = {}, {}, [], []

    def visit(path):
        number[path] = low[path] = len(number)
        open_files.append(path)
        for target in imports[path]:
            if target not in number:
                visit(target)
            if target in open_files:
                low[path] = min(low[path], low[target])
        if low[path] == number[path]:
            members = open_files[open_files.index(path) :]
            del open_files[-len(members) :]
            if len(members) > 1:
                found.append(sorted(members))

    for path in imports:
        if path not in number:
            visit(path)
    return found


def test_no_files_import_each_other_in_a_circle():
    assert circles({path: imports_of(path)[0] for path in SOURCES}) == []  # lazy and type imports are arrows, too


def test_a_circle_is_found():
    arrows_of = {"a": "b", "b": "cd", "c": "a", "d": "e", "e": "", "f": "gd", "g": "f"}
    assert circles(arrows_of) == [["a", "b", "c"], ["f", "g"]]


def test_files_that_import_by_text_are_listed():
    found = [path for path in SOURCES if re.search(r"\bimport_module\(|\b__import__\(", path.read_text())]
    assert {path.relative_to(ROOT).as_posix() for path in found} == set(BY_TEXT)


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_what_they_may(package):
    for path in (path for path in SOURCES if path.relative_to(ROOT).parts[0] == package):
        own, other = imports_of(path)
        assert {target.relative_to(ROOT).parts[0] for target in own} <= ALLOWED[package] | {package}, path
        assert "palpate" not in other, path  # siblings are imported relatively
        assert package == "render" or package == "kernels" or "warp" not in other, path
        assert package != "kernels" or not other & {"h5py", "usb", "trimesh"}, path


def test_folders_are_small_and_say_what_they_hold():
    held = Counter(folder_of(path) for path in SOURCES if not is_init(path))
    held.update(folder_of(path) for path in (ROOT / "tests").rglob("*.py"))
    assert {name: count for name, count in held.items() if count > MODULES_MOST} == {}
    for folder in {path.parent for path in SOURCES}:
        line = (ast.get_docstring(ast.parse((folder / "__init__.py").read_text())) or "").partition("\n")[0]
        assert line.endswith("."), folder
    assert not (ROOT / "palpate").exists()  # it would hide the namespace


def test_no_module_repeats_its_folder_and_none_is_for_odds_and_ends():
    for path in SOURCES:
        folder = path.parent.name
        assert path.stem != folder, path
        assert not path.stem.startswith(f"{folder}_"), path
        assert not re.search(r"util|common|helper|manager|misc", path.stem), path


def test_a_class_name_stands_once():
    places = defaultdict(list)
    for path in SOURCES:
        for node in tree_of(path).body:
            if isinstance(node, ast.ClassDef):
                places[node.name].append(folder_of(path))
    assert {name for name, folders in places.items() if len(folders) > 1} == SHARED


def test_tests_mirror_the_packages():
    for path in (ROOT / "tests").rglob("test_*.py"):
        place = path.parent.relative_to(ROOT / "tests")
        assert (
            place.parts[0] in ("house", "faults") or place.parts[:2] == ("device", "tiers") or (ROOT / place).is_dir()
        )


def test_documents_import_public_names_only():
    import palpate.datasets
    import palpate.device
    import palpate.render

    public = {name: set(getattr(palpate, name).__all__) for name in ("datasets", "device", "render")}
    pages = [
        page for page in (ROOT / "docs").rglob("*.md") if not page.name.startswith("add-a")
    ]  # they show new modules
    for page in [ROOT / "README.md", *pages]:
        text = page.read_text()
        for module, names in re.findall(r"^\s*from palpate\.([\w.]+) import ([\w, ]+)", text, re.MULTILINE):
            assert module in public, (page.name, module)
            assert {name.strip() for name in names.split(",")} <= public[module], (page.name, names)
        for package, name in re.findall(r"`palpate\.(datasets|device|render)\.(\w+)", text):
            assert name in public[package] | {"cli"}, (page.name, name)


def test_files_that_documents_name_are_there():
    named = re.compile(r"\b(?:tests|render|kernels|datasets|device|docs|benchmarks)/[\w/-]+\.(?:py|md|sh|vhd)\b")
    pages = [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")]
    for page in (page for page in pages if not page.name.startswith("add-a")):  # those add files
        assert [name for name in named.findall(page.read_text()) if not (ROOT / name).exists()] == [], page


@pytest.mark.parametrize("script", ["lowest", "wheel"])
def test_tests_that_ci_names_are_there(script):
    text = (ROOT / ".ci" / script).read_text()
    named = re.findall(r"^tests=\((.*?)\)", text, re.MULTILINE | re.DOTALL)[0].split()
    assert len(named) > 3
    assert [name for name in named if not (ROOT / "tests" / f"{name}.py").exists()] == []


def test_every_folder_is_packed():
    packed = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    assert packed == {"palpate." + folder_of(path).replace("/", ".") for path in SOURCES}


@pytest.mark.parametrize("package", PACKAGES)
def test_files_and_kernels_stay_small(package):
    for path in (path for path in SOURCES if path.relative_to(ROOT).parts[0] == package):
        text = path.read_text()
        assert text.count("\n") <= 800, path
        for node in ast.walk(tree_of(path)) if "wp.kernel" in text else ():
            if isinstance(node, ast.FunctionDef) and any("wp.kernel" in ast.unparse(d) for d in node.decorator_list):
                require_small_kernel(node, text)


def require_small_kernel(node, text):
    assert node.end_lineno - node.lineno <= 65, node.name
    assert len(node.args.args) <= 16, node.name
    assert node.name.startswith("_"), node.name
    assert ast.get_docstring(node), node.name
    if sum(holds_array(argument.annotation) for argument in node.args.args) > 4:
        signature = "\n".join(text.splitlines()[node.lineno - 1 : node.body[0].lineno])
        assert "# In:" in signature, node.name
        assert "# Out:" in signature, node.name


def holds_array(annotation):
    """Whether a parameter of a kernel is an array or a struct of arrays, as the data of a field's function are."""
    name = ast.unparse(annotation)
    is_value = name in ("int", "float", "bool") or name in structs_without_arrays() or name.startswith("wp.")
    return name.startswith("wp.array") or not is_value


@cache
def structs_without_arrays():
    struct = re.compile(r"^@wp\.struct\nclass (\w+).*\n((?:(?: .*)?\n)*)", re.MULTILINE)
    bodies = dict(found for path in (ROOT / "kernels").rglob("*.py") for found in struct.findall(path.read_text()))
    holding = ["wp.array"]
    while more := [
        name for name in bodies if name not in holding and re.search(rf": ({'|'.join(holding)})\b", bodies[name])
    ]:
        holding += more
    return bodies.keys() - holding


def test_a_struct_of_arrays_counts_as_an_array():
    arguments = "a: wp.array[int], b: Surface, c: wp.array2d[wp.vec3], d: data_type, e: int, f: wp.vec3, g: Frame"
    parameters = ast.parse(f"def _k({arguments}): pass").body[0].args.args
    assert [holds_array(parameter.annotation) for parameter in parameters] == [True] * 4 + [False] * 3
    kernel = "def _k(\n    a: wp.array[int], b: Surface, c: data_type, d: data_type, e: data_type,\n):\n    'Why.'"
    with pytest.raises(AssertionError, match="_k"):
        require_small_kernel(ast.parse(kernel).body[0], kernel)
    for text in (kernel.replace(" e: data_type", " e: int"), kernel.replace("    a", "    # In:\n    # Out:\n    a")):
        require_small_kernel(ast.parse(text).body[0], text)


OWN_KERNEL = re.compile(r"@wp\.kernel(\(launch_bounds=.*\))?\n")  # of its file's module; blocks may be bounded


def test_kernel_modules_are_compiled_exactly():
    for path in (ROOT / "kernels").rglob("*.py"):
        text = path.read_text()
        assert not OWN_KERNEL.search(text) or re.search(r"wp.set_module_options\((EXACT|SELDOM)\)", text), path
        decorators = {line.strip() for line in text.splitlines() if line.strip().startswith("@wp.kernel")}
        assert all(OWN_KERNEL.match(line + "\n") or line == "@wp.kernel(**MODULE)" for line in decorators), path


def test_precompiling_covers_every_kernel_module():
    from palpate.kernels import STAGES

    compiled = [path for path in SOURCES if OWN_KERNEL.search(path.read_text())]
    assert {
        path.relative_to(ROOT / "kernels").with_suffix("").as_posix().replace("/", ".") for path in compiled
    } == set(STAGES)


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
        assert f"palpate/{path.relative_to(ROOT).as_posix()}" in listed
    for package in PACKAGES:
        assert f"palpate/{package}/py.typed" in listed
    assert not [name for name in listed if name.startswith(("tests", "palpate/tests"))]


def test_readme_is_short_and_its_commands_are_those_that_ci_runs():
    readme = (ROOT / "README.md").read_text()
    assert readme.count("\n") <= 90
    commands = re.findall(r"^(?:    |)(python3 -m venv .*)$", readme, re.MULTILINE)
    assert len(commands) == 2
    ci = (ROOT / ".ci" / "run").read_text()
    assert "README.md" in ci  # it takes the command from there


def test_what_scripts_import_is_found_under_its_name_whatever_was_imported_before():
    import palpate.render as pipeline

    assert sorted(pipeline.__all__) == sorted(pipeline._HOMES)
    rooms = {path.stem for path in (ROOT / "render").iterdir()}
    assert not rooms & set(pipeline.__all__)  # importing a room of that name would hide it
    for name in pipeline.__all__:
        assert getattr(pipeline, name) is getattr(import_module(f".{pipeline._HOMES[name]}", "palpate.render"), name)
    with pytest.raises(AttributeError, match="nothing"):
        _ = pipeline.nothing


def parses_json(tree):
    """Whether a module names a parser of the standard library's json."""
    names = {"load", "loads", "JSONDecoder"}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "json" and names & {own.name for own in node.names}:
            return True
        if isinstance(node, ast.Attribute) and node.attr in names and getattr(node.value, "id", "") == "json":
            return True
    return False


def test_only_listed_modules_parse_json_without_bounds():
    named = [path for path in SOURCES if re.search(r"\bjson\b", path.read_text()) is not None]  # quick: most have not
    found = {path.relative_to(ROOT).as_posix() for path in named if parses_json(tree_of(path))}
    assert found == JSON_UNBOUNDED.keys()


@pytest.mark.parametrize("text", ["json.loads(a)", "from json import load", "read = json.load", "json.JSONDecoder()"])
def test_a_parser_is_found_however_it_is_named(text):
    assert parses_json(ast.parse(text))
    assert not parses_json(ast.parse("json.dumps(a); pickle.loads(a)"))
