"""What `palpate view` does: a page that is served until Ctrl-C, or one that is written."""

from pathlib import Path
from tempfile import TemporaryDirectory

import h5py

from ...datasets.sweeps.merging import is_store
from ...device.playing.signals import ending_on_signals
from ..coordinate_spacing import apart_text, joining_place
from ..errors import MeshError, StrategyError
from ..intersection.file_recording import polylines_in, record
from ..intersection.named_inputs import load_hand_and_motion, load_solid
from ..objects.mesh.placement import Placement
from ..playback.placed_arrays import load_rig
from ..runtime.warp_start import start_warp
from ..strategies.intersection_strategy import closed_contour, open_contour
from ..terminal import bars, console
from ..terminal.foreign_text import write_output
from ..validation import refuse_object
from ..view.page.export import LIMIT, export_page
from ..view.served.viewing import announce, open_browser, view_files
from .contour_options import ViewCommand
from .shared_options import PlacementOptions

POSES_PREVIEWED = 10_000


def run_view(job: ViewCommand, *, as_json: bool) -> None:
    """Serve until Ctrl-C, or export; an object and a motion are rendered first, into a file that is then removed."""
    if job.is_preview:
        # SIGTERM, too, must end the `with`, else the folder stays.
        with ending_on_signals(), TemporaryDirectory(prefix="palpate-preview-") as folder:
            made = preview(job, Path(folder), as_json=as_json)
            _view([made], job, f"a preview of {job.files[0]}", as_json=as_json)
        return
    with ending_on_signals():
        _view(job.files, job, " and ".join(map(str, job.files)), as_json=as_json)


def preview(job: ViewCommand, folder: Path, *, as_json: bool) -> Path:
    """Render an object's closed contours on a palm, for POSES_PREVIEWED poses at most; the file's path.

    Raises what `palpate render` does of an object and a motion; an open mesh is shown with open contours.
    """
    start_warp()
    source, motion = map(str, job.files)
    placement = Placement(**job.part(PlacementOptions))
    with bars.progress_bar(source, quiet=as_json) as watch:
        solid = load_solid(source, placement, volume={}, mesh={}, bounds=None, watch=watch)
    hand, moved = load_hand_and_motion(
        "palm", None, motion, solid, exploration_options={"rate": None}, alignment=job.alignment
    )
    out = folder / f"preview of {Path(source).stem}.h5"
    try:
        solid.require_closed()
        strategy = closed_contour()
    except MeshError as error:
        console.warn(f"shown with open contours (OC): {error}")
        strategy = open_contour()
    with bars.progress_bar("poses", quiet=as_json) as bar:
        record(out, solid, hand, moved[:POSES_PREVIEWED], strategy, progress=bar)
    if polylines_in(out) == 0:
        console.warn(f"{apart_text(solid.bounds, moved.pose)}; --at {joining_place(moved.pose)} joins them")
    return out


def _view(files: list[Path], job: ViewCommand, what: str, *, as_json: bool) -> None:
    for file in files:
        if not is_store(file):
            refuse_object(file)
    if job.export is not None:
        _export(files, job, job.export, as_json=as_json)
        return
    for file in files:
        if file.suffix.lower() in (".html", ".htm") and file.exists() and not h5py.is_hdf5(file):
            raise StrategyError(f"{file} is a page: open it in a browser")
    start_warp()

    def tell(address: str) -> None:
        if as_json:
            write_output(console.json_line({"address": address}))
            if not job.no_browser:
                open_browser(address)
        else:
            announce(address, what, no_browser=job.no_browser)

    try:
        view_files(
            files,
            port=job.port,
            array=job.array,
            calibration=job.calibration,
            allow_code=job.allow_code,
            ready=tell,
        )
    except KeyboardInterrupt:
        return


def _export(files: list[Path], job: ViewCommand, out: Path, *, as_json: bool) -> None:
    """Write one page of all files, and say how large it is."""
    for file in files:
        if is_store(file):
            raise StrategyError(f"{file} is a sweep's store: --export takes contour files")
    start_warp()
    with bars.progress_bar(f"writing {out}", quiet=as_json):
        facts = export_page(
            files,
            out,
            poses=job.poses,
            every=job.every,
            limit=LIMIT if job.limit is None else job.limit,
            overwrite=job.overwrite,
            array=load_rig(job.array, calibration=job.calibration),
            pressure=job.pressure,
        )
    console.show_values(facts, as_json=as_json, title="page")
