"""Files get their names by `datasets/storage/durable.py` alone, so that no reader ever meets a part of one.

A call that makes, replaces or renames a file may stand elsewhere only where it writes to memory, to a variable or
attribute named `temporary`, or where `EXCEPTIONS` says why it must.
"""

import ast
import re
from collections.abc import Iterator

from rooms import ROOT, tree_of

RENAMES = {"os.replace", "os.rename", "os.renames", "shutil.move", "shutil.copy", "shutil.copy2", "shutil.copyfile"}
WRITES = {"np.save", "np.savez", "np.savez_compressed", "np.savetxt"}
METHODS_THAT_WRITE = {"savefig", "imsave"}
OPENS = {"open", "fdopen", "ZipFile", "File"}
MODE = re.compile(r"[wx][bt+]*|r[bt]*\+[bt]*")
MEMORY = {"BytesIO", "StringIO"}
WORDS = (
    "os.re", ".rename(", ".write_", "np.save", "shutil.", "savefig", "imsave",
    *(f'"{mode}{end}' for mode in "wx" for end in ('"', "b", "t", "+")), '"r+', '"rb+', '"r+b',
)  # fmt: skip
MOVE = re.compile(r"\.replace\([^,]*[()]")
"""Text without which no call is found; modes have double quotes, as ruff formats them."""

EXCEPTIONS = {
    ("datasets/storage/hdf5_output.py", "File"): "libhdf5 writes to a stream of ours, which keeps what goes wrong",
    ("datasets/storage/sqlite_opening.py", "shutil.copyfile"): "into a folder that goes once the copy is read",
    ("datasets/sweeps/merging.py", "shutil.copyfile"): "into the scratch folder, from which the store moves it",
    ("datasets/sweeps/store.py", "os.replace"): "a kept file that is whole moves into its folder",
    ("datasets/sweeps/store.py", "write_bytes"): "into the scratch folder, from which the store moves it",
    ("device/live/writer_handle.py", "open"): "to a process of its own, in a folder that goes with both",
    ("device/live/writer_handle.py", "write_text"): "to a process of its own, in a folder that goes with both",
    ("render/exports/contour_tables.py", "open"): "a member of an archive under a temporary name",
    ("render/runtime/sealed_kernels.py", "os.rename"): "a folder that is damaged goes out of the way at once",
}
"""Calls that stand elsewhere, by file, with their reason."""


def is_suspicious(source: str) -> bool:
    """Whether a file must be looked at: a quick look at its text, as most files write nothing."""
    return any(word in source for word in WORDS) or MOVE.search(source) is not None


def written_targets(tree: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Name of each call that makes, replaces or renames a file, and what it writes to."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute | ast.Name):
            continue
        owner = node.func.value if isinstance(node.func, ast.Attribute) else None
        name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
        full = f"{owner.id}.{name}" if isinstance(owner, ast.Name) else name
        args = [*node.args, *(own.value for own in node.keywords if own.arg == "mode")]
        modes = [k for k, own in enumerate(args) if isinstance(own, ast.Constant) and MODE.fullmatch(str(own.value))]
        if full in RENAMES:
            yield full, node.args[-1]
        elif owner is not None and (name == "rename" or (name == "replace" and len(args) == 1 and not node.keywords)):
            yield name, node.args[0]
        elif name in ("write_text", "write_bytes") and owner is not None:
            yield name, owner
        elif args and (full in WRITES or name in METHODS_THAT_WRITE):
            yield name, args[0]
        elif name in OPENS and modes and not any(own.arg == "driver" for own in node.keywords):  # of HDF5, in memory
            yield name, owner if modes[0] == 0 and owner is not None else args[0]


def unpublished(tree: ast.Module) -> list[str]:
    """Calls that write to a path which is neither temporary nor in memory."""
    memory = {
        target.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)
        for target in node.targets
        if isinstance(target, ast.Name) and ast.unparse(node.value.func).rpartition(".")[2] in MEMORY
    }
    return [
        name
        for name, target in written_targets(tree)
        if ast.unparse(target).removeprefix("str(").removesuffix(")").rpartition(".")[2] != "temporary"
        and not (isinstance(target, ast.Name) and target.id in memory)
        and not (
            isinstance(target, ast.NamedExpr)
            and ast.unparse(target.value).partition("(")[0].rpartition(".")[2] in MEMORY
        )
    ]


def test_files_get_their_names_in_one_place():
    found = {
        (path, name)
        for package in ("datasets", "render", "device")
        for file in (ROOT / package).rglob("*.py")
        if (path := file.relative_to(ROOT).as_posix()) != "datasets/storage/durable.py"
        if is_suspicious(file.read_text("utf-8"))
        for name in unpublished(tree_of(file))
    }
    assert found == EXCEPTIONS.keys()


UNPUBLISHED = """
os.replace(made, path)
os.rename(made, path)
shutil.copyfile(made, path)
path.rename(other)
made.replace(path)
path.write_text("a")
(folder / "a").write_bytes(b"a")
open(path, "w")
open(path, mode="wb")
path.open("xb")
gzip.open(path, "wt")
h5py.File(path, "r+")
zipfile.ZipFile(path, "w")
np.save(path, values)
np.savez_compressed(folder / "a.npz", values=values)
figure.savefig(path, dpi=150)
plt.imsave(path, pixels)
"""

PUBLISHED = """
content = io.BytesIO()
np.savez(content, values=values)
np.savez(stream := BytesIO(), values=values)
figure.savefig(content, format="png")
new.temporary.write_text("a")
temporary.open("w")
zipfile.ZipFile(temporary, "w")
volume.save(str(new.temporary))
h5py.File("image", "w", driver="core", backing_store=False)
open(path)
open(path, "a")
path.open("rb")
text.replace("a", "b")
replace(value, name="b")
moment.replace(tzinfo=None)
"""


def test_a_call_that_is_added_is_found():
    lines = UNPUBLISHED.strip().splitlines()
    assert [len(unpublished(ast.parse(line))) for line in lines] == [1] * len(lines)
    assert all(map(is_suspicious, lines))
    assert unpublished(ast.parse(PUBLISHED)) == []
