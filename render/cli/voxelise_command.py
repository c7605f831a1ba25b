"""`palpate voxelise`: a mesh into a volume file."""

import math
from pathlib import Path
from time import perf_counter

from ..errors import StrategyError
from ..objects.mesh.placement import Placement
from ..objects.voxels.files import WRITERS
from ..objects.voxels.voxeliser import SIGNS, voxelise_file
from ..runtime.warp_start import start_warp
from ..runtime.worker_devices import worker_devices
from ..terminal import bars, console
from ..validation import choose

VOXELISED_KINDS = ("distance", "occupancy")


def run_voxelise(
    mesh: str,
    out: Path,
    spacing: float,
    kind: str,
    sign: str,
    placement: dict,
    device: str,
    overwrite: bool,
    *,
    as_json: bool,
) -> None:
    """Voxelise, write, say what came of it."""
    kind, sign = choose("--kind", kind, VOXELISED_KINDS), choose("--sign", sign, SIGNS)
    if not 0 < spacing < math.inf:  # a NaN compares false
        raise StrategyError(f"--spacing must be a positive length in metres, not {spacing}")
    if not out.name.lower().endswith(tuple(WRITERS)):
        raise StrategyError(f"{out}: voxels are written to {', '.join(WRITERS)}")
    if out.exists() and not overwrite:
        raise StrategyError(f"{out}: exists; --overwrite replaces it")
    start_warp()
    started = perf_counter()
    place, name = Placement(**placement), worker_devices(device, 1)[0]
    with bars.loading_bar(mesh, quiet=as_json) as watch:
        facts = voxelise_file(
            mesh,
            out,
            spacing=spacing,
            placement=place,
            kind=kind,
            sign=sign,
            device=name,
            watch=watch,
            overwrite=overwrite,
        )
    seconds = perf_counter() - started
    console.show_values({**facts, "bytes": out.stat().st_size, "seconds": seconds}, as_json=as_json, title=str(out))
