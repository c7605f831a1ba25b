"""The code version that results are stored under: the code that computes results, and the libraries that it uses.

| palpate runs from | its own code counts by |
|---|---|
| a checkout, also installed as editable | the bytes of `COMPUTING`, comments included |
| an installed package | palpate's version |
"""

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path

HOUSE = Path(__file__).resolve().parents[3]
"""Folder of palpate's packages."""
COMPUTING = (
    "kernels/**/*.py",
    *(f"datasets/{folder}/**/*.py" for folder in ("hand_model", "motions", "recordings", "shapes")),
    "device/boards/*/kind.py",
    *(f"render/{folder}/**/*.py" for folder in ("acoustics", "hands", "intersection", "motions", "objects")),
    *(f"render/{folder}/**/*.py" for folder in ("playback", "sampling", "stages", "strategies", "sweeps/make")),
    *(f"{package}/*.py" for package in ("datasets", "device", "render")),
)
"""Patterns of the files that compute results, from `HOUSE` on."""
LIBRARIES = ("numpy", "scipy", "trimesh", "manifold3d", "warp-lang")
"""Those that decide numbers: arrays; nearest points, components, filters; meshes of scripts; solids united;
kernels. h5py and xxhash only store, nibabel and pynrrd return the values that a file has."""


@cache
def code_version() -> str:
    """Text that names the code that makes results; results are looked up for the same text only.

    Read once in each process, in some 30 ms: whoever edits a file restarts the process.
    """
    is_checkout = (HOUSE / "pyproject.toml").is_file()
    own = f"code {files_digest(COMPUTING)}" if is_checkout else version("palpate")
    return f"palpate {own}, {', '.join(f'{name} {version(name)}' for name in LIBRARIES)}"


def files_digest(patterns: Iterable[str], house: Path = HOUSE) -> str:
    """16 hexadecimal digits of the SHA-256 of files' paths and bytes.

    patterns: from `house` on. The digest does not depend on where `house` is.
    """
    total = hashlib.sha256()
    paths = {path for pattern in patterns for path in house.glob(pattern)}
    for name, path in sorted((path.relative_to(house).as_posix(), path) for path in paths):
        total.update(f"{name} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return total.hexdigest()[:16]
