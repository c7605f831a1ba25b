"""What `palpate view` does: a page that is served until Ctrl-C, or one that is written."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py

from ...datasets.recordings.files import JOINT_SUFFIXES
from ...datasets.sweeps.merging import is_store
from ...device.playing.signals import ending_on_signals
from ..coordinate_spacing import apart_text, joining_place
from ..errors import MeshError, StrategyError
from ..intersection.file_recording import polylines_in, record
from ..intersection.named_inputs import EXPLORATION, load_hand_and_motion, load_solid
from ..objects.mesh.placement import Placement
from ..playback.placed_arrays import load_rig
from ..runtime.warp_start import start_warp
from ..strategies.intersection_strategy import closed_contour, open_contour
from ..terminal import bars, console
from ..terminal.foreign_text import write_output
from ..validation import refuse_object
from ..view.page.export import LIMIT, export_page
from ..view.served.viewing import announce, open_browser, view_files

POSES_PREVIEWED = 10_000
MOTION_SUFFIXES = (".csv", *JOINT_SUFFIXES)
NO_PLACEMENT = {"scale": 1.0, "up": "z", "fit": None, "rotate": (0.0, 0.0, 0.0), "at": None}
OF_A_PAGE = ("poses", "every", "limit", "pressure", "overwrite")
OF_A_SERVER = ("port", "no_browser", "allow_code")


def run_view(files: list[Path], options: dict[str, Any], *, as_json: bool) -> None:
    """Serve until Ctrl-C, or export; an object and a motion are rendered first, into a file that is then removed."""
    placement, alignment = options.pop("placement"), options.pop("alignment")
    if is_preview(files):
        # SIGTERM, too, must end the `with`, else the folder stays.
        with ending_on_signals(), TemporaryDirectory(prefix="palpate-preview-") as folder:
            made = preview(str(files[0]), str(files[1]), placement, alignment, Path(folder), as_json=as_json)
            _view([made], options, f"a preview of {files[0]}", as_json=as_json)
        return
    if placement != NO_PLACEMENT or alignment is not None:
        raise StrategyError("--scale, --up, --fit, --rotate, --at and --alignment are of a preview: OBJECT MOTION")
    with ending_on_signals():
        _view(files, options, " and ".join(map(str, files)), as_json=as_json)


def is_preview(files: list[Path]) -> bool:
    """Whether an object and a motion are given, not files of contours."""
    return len(files) == 2 and (str(files[1]) == EXPLORATION or files[1].suffix.lower() in MOTION_SUFFIXES)


def preview(
    source: str, motion: str, placement: dict[str, Any], alignment: Path | None, folder: Path, *, as_json: bool
) -> Path:
    """Render an object's closed contours on a palm, for POSES_PREVIEWED poses at most; the file's path.

    Raises what `palpate render` does of an object and a motion; an open mesh is shown with open contours.
    """
    start_warp()
    with bars.loading_bar(source, quiet=as_json) as watch:
        solid = load_solid(source, Placement(**placement), volume={}, mesh={}, bounds=None, watch=watch)
    options: dict[str, Any] = dict.fromkeys(("duration", "rate", "seed"))
    hand, moved = load_hand_and_motion("palm", None, motion, solid, exploration_options=options, alignment=alignment)
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


def _view(files: list[Path], options: dict[str, Any], what: str, *, as_json: bool) -> None:
    for file in files:
        if len(files) > 1 and file.suffix.lower() in MOTION_SUFFIXES and file.exists():
            raise StrategyError(f"{file} is a motion: a preview takes the object first, then the motion")
        if not is_store(file):
            refuse_object(file)
    if options["export"] is not None:
        _refuse_given(options, OF_A_SERVER, "of a page that is served; --export writes one")
        _export(files, options, as_json=as_json)
        return
    _refuse_given(options, OF_A_PAGE, "of a page that --export writes")
    for file in files:
        if file.suffix.lower() in (".html", ".htm") and file.exists() and not h5py.is_hdf5(file):
            raise StrategyError(f"{file} is a page: open it in a browser")
    start_warp()

    def tell(address: str) -> None:
        if as_json:
            write_output(console.json_line({"address": address}))
            if not options["no_browser"]:
                open_browser(address)
        else:
            announce(address, what, no_browser=options["no_browser"])

    try:
        view_files(
            files,
            port=options["port"],
            array=options["array"],
            calibration=options["calibration"],
            allow_code=options["allow_code"],
            ready=tell,
        )
    except KeyboardInterrupt:
        return


def _export(files: list[Path], options: dict[str, Any], *, as_json: bool) -> None:
    """Write one page of all files, and say how large it is."""
    for file in files:
        if is_store(file):
            raise StrategyError(f"{file} is a sweep's store: --export takes contour files")
    start_warp()
    with bars.loading_bar(f"writing {options['export']}", quiet=as_json):
        facts = export_page(
            files,
            options["export"],
            poses=options["poses"],
            every=options["every"],
            limit=LIMIT if options["limit"] is None else options["limit"],
            overwrite=options["overwrite"],
            array=load_rig(options["array"], calibration=options["calibration"]),
            pressure=options["pressure"],
        )
    console.show_values(facts, as_json=as_json, title="page")


def _refuse_given(options: dict[str, Any], names: tuple[str, ...], belonging: str) -> None:
    for name in names:
        if options[name] is not None and options[name] is not False:  # 0 is given
            raise StrategyError(f"--{name.replace('_', '-')} is {belonging}")
