"""What `palpate export` and `palpate voxelise` do: contours and meshes as files of other kinds."""

from time import perf_counter

from ..exports.file_export import export_file
from ..objects.mesh.placement import Placement
from ..objects.voxels.voxeliser import voxelise_file
from ..runtime.warp_start import start_warp
from ..runtime.worker_devices import worker_devices
from ..terminal import bars, console
from .contour_options import ExportCommand, VoxeliseCommand
from .shared_options import PlacementOptions


def run_export(job: ExportCommand, *, as_json: bool) -> None:
    """Export and report."""
    start_warp()
    with bars.progress_bar(f"exporting {job.file}", quiet=as_json) as watch:
        values = export_file(
            job.file,
            job.out,
            to=job.to,
            poses=job.poses,
            seconds=job.seconds,
            every=job.every,
            scene=job.scene,
            gzip=job.gzip,
            sampling=job.sampling,
            speed=job.speed,
            update_rate=job.update_rate,
            duration=job.duration,
            overwrite=job.overwrite,
            watch=watch,
        )
    console.show_values(values, as_json=as_json, title=str(job.out))


def run_voxelise(job: VoxeliseCommand, *, as_json: bool) -> None:
    """Voxelise, write, and print a summary."""
    start_warp()
    started = perf_counter()
    with bars.progress_bar(job.mesh, quiet=as_json) as watch:
        facts = voxelise_file(
            job.mesh,
            job.out,
            spacing=job.spacing,
            placement=Placement(**job.part(PlacementOptions)),
            kind=job.kind,
            sign=job.sign,
            device=worker_devices(job.device, 1)[0],
            watch=watch,
            overwrite=job.overwrite,
        )
    values = {**facts, "bytes": job.out.stat().st_size, "seconds": perf_counter() - started}
    console.show_values(values, as_json=as_json, title=str(job.out))
