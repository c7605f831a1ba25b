"""The rooms of the house and the arrows between them: which folder imports which, and what content it holds."""

import ast
import hashlib
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("kernels", "render", "device", "datasets")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))

BY_TEXT = {
    "device/registry.py": ("device/boards",),
    # The others import modules of their own room, other packages, or what a user wrote; or they give public names, and
    # `public_homes` knows the rooms of these.
    **dict.fromkeys(
        (
            "datasets/__init__.py",
            "datasets/storage/hdf5_declared.py",
            "datasets/sweeps/table.py",
            "device/__init__.py",
            "kernels/__init__.py",
            "render/__init__.py",
            "render/cli/command_group.py",
            "render/cli/option_fields.py",
            "render/objects/voxels/files.py",
            "device/playing/watchdog.py",
            "render/stages/registry.py",
            "render/trust/user_code.py",
        ),
        (),
    ),
}
"""Files that import modules by name, as a text, which no syntax tree shows; and the rooms that they import so."""


def folder_of(path: Path) -> str:
    """The room of a file: its folder, from the root; "" is the root itself."""
    folder = path.parent.relative_to(ROOT).as_posix()
    return "" if folder == "." else folder


def is_init(path: Path) -> bool:
    return path.name == "__init__.py"


@cache
def tree_of(path: Path) -> ast.Module:
    """The syntax tree of a file of the source, parsed once."""
    return ast.parse(path.read_text())


@cache
def imports_of(path: Path) -> tuple[set[Path], set[str]]:
    """Files of the house, and names of other packages, that a file imports; lazily or for type checkers, too."""
    own: set[Path] = set()
    other: set[str] = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            other.update(name.name.split(".")[0] for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            other.add(str(node.module).split(".")[0])
        elif isinstance(node, ast.ImportFrom):
            base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for name in node.names:
                named = [base / f"{name.name}.py", base / name.name / "__init__.py"]
                named += [base.with_suffix(".py"), base / "__init__.py"]
                own.add(next(file for file in named if file.exists()))
    return own, other


@cache
def importers() -> dict[str, set[str]]:
    """For each room of the source, the rooms that import it; what an `__init__` re-exports is no arrow."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in SOURCES:
        name = path.relative_to(ROOT).as_posix()
        rooms = {folder_of(target) for target in (() if is_init(path) else imports_of(path)[0])}
        for room in rooms | set(BY_TEXT.get(name, ())):
            if room != folder_of(path):
                found[room].add(folder_of(path))
    return found


@cache
def public_homes() -> dict[str, dict[str, str]]:
    """The room of each public name, for each package that gives public names lazily."""
    found = {}
    for package in PACKAGES:
        for node in ast.parse((ROOT / package / "__init__.py").read_text()).body:
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                imports = [each for each in node.body if isinstance(each, ast.ImportFrom)]
                homes = [folder_of(module_file(package, "." * (each.level - 1) + str(each.module))) for each in imports]
                names = zip(homes, imports, strict=True)
                found[package] = {alias.name: room for room, each in names for alias in each.names}
    return found


def module_file(package: str, module: str) -> Path:
    """The file of a module, by its name within a package, or with a leading dot within the house."""
    base = ROOT.joinpath(*([] if module.startswith(".") else [package]), *module.strip(".").split("."))
    return base / "__init__.py" if base.is_dir() else base.with_suffix(".py")


MODULE = re.compile(r"\bpalpate((?:\.[a-z_0-9]+)+)(?: import (?:\(([^)]*)\)|([^\n]*)))?")


@cache
def imported_rooms(path: Path) -> frozenset[str]:
    """Rooms of the source that a test file names: by its imports, and as text, as child processes import them."""
    found = set()
    for module, several, one in MODULE.findall(path.read_text()):
        names = re.findall(r"\w+", several or one)
        homes = public_homes().get(module.strip("."), {})
        found.update(homes[name] for name in names if name in homes)
        base = ROOT.joinpath(*module.strip(".").split("."))
        while not base.is_dir():  # a module, or an attribute of one
            base = base.parent
        found.add(base.relative_to(ROOT).as_posix())
    return frozenset(found)


SKIPPED = {"__pycache__", "node_modules", "proved"}
ROOT_FILES = (
    "pyproject.toml",
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "CITATION.cff",
    "MANIFEST.in",
    "mkdocs.yml",
)
"""Files of the root, each a room of its own; others that lie there are nobody's."""


@cache
def digests() -> dict[str, str]:
    """A digest of the content of each folder, its subfolders apart, and of files of the root.

    Hidden folders do not count, but for .ci; nor do those that .gitignore names.
    """
    ignored = SKIPPED | {line.strip("/*") for line in (ROOT / ".gitignore").read_text().split()}
    rooms: dict[str, hashlib._Hash] = {}
    for path in sorted(ROOT.rglob("*")):
        parts = path.relative_to(ROOT).parts
        hidden = any(part.startswith(".") and part != ".ci" for part in parts)
        stray = len(parts) == 1 and path.name not in ROOT_FILES
        if hidden or stray or ignored & set(parts) or ".egg-info" in parts[0] or not path.is_file():
            continue
        content = hashlib.sha256(path.read_bytes()).digest()
        rooms.setdefault(folder_of(path) or path.name, hashlib.sha256()).update(path.name.encode() + b"\0" + content)
    return {room: digest.hexdigest()[:32] for room, digest in rooms.items()}
