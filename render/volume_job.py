"""`palpate voxelise`: a mesh into a volume file."""

from pathlib import Path
from time import perf_counter

from . import console
from .objects import Placement
from .voxelise import voxelise_file
from .workers import worker_devices


def run_voxelise(
    mesh: str, out: Path, spacing: float, kind: str, sign: str, placement: dict, device: str, *, as_json: bool
) -> None:
    """Voxelise, write, say what came of it."""
    console.start_warp()
    started = perf_counter()
    place, name = Placement(**placement), worker_devices(device, 1)[0]
    told = voxelise_file(mesh, out, spacing=spacing, placement=place, kind=kind, sign=sign, device=name)
    seconds = perf_counter() - started
    console.say({**told, "bytes": out.stat().st_size, "seconds": seconds}, as_json=as_json, title=str(out))
