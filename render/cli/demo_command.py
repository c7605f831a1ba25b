"""The main job in one go, for `palpate demo`."""

from pathlib import Path
from time import perf_counter

from ...datasets.errors import ContourFileError
from ...kernels import PLAYING_STAGES
from ..errors import StrategyError
from ..hands.hand import Palm
from ..intersection.file_recording import record
from ..motions.explorations.explored import exploration
from ..objects.mesh.solid_mesh import MeshObject
from ..playback.file_playback import CLOCKS, Connection, play_file
from ..reports.contour_figure import draw_figure
from ..reports.file_summary import summarise
from ..runtime.kernel_compiling import CompilingAhead
from ..runtime.warp_start import start_warp
from ..strategies.intersection_strategy import closed_contour, open_contour
from ..terminal import bars, console
from ..validation import choose

FOLDER = Path("palpate-demo")
"""The demonstration's own folder, whose files it replaces."""
NAMES = ("motion.csv", "tube-oc.h5", "tube-cc.h5", "tube.png")


def run_demo(folder: Path, clock: str, overwrite: bool, *, as_json: bool) -> None:
    """Explore the tube for 30 s, render OC and CC, play CC on the emulated array, draw a picture."""
    started = perf_counter()
    there = [folder / name for name in NAMES if (folder / name).exists()]
    if there and folder != FOLDER and not overwrite:
        raise StrategyError(f"{there[0]}: exists; --overwrite replaces it")
    connection = Connection(clock=choose("clock", clock, tuple(CLOCKS)))
    start_warp()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ContourFileError(f"{folder}: cannot be made ({error.strerror})") from error
    with CompilingAhead(PLAYING_STAGES) as ahead:
        mesh = MeshObject.load("tube")
        hand = Palm()
        motion = exploration(mesh.bounds, duration=30.0, rate=90.0, seed=1)
        motion.save(folder / "motion.csv", overwrite=True)
        files = {"OC": folder / "tube-oc.h5", "CC": folder / "tube-cc.h5"}
        for label, strategy in (("OC", open_contour()), ("CC", closed_contour())):
            with bars.progress_bar(f"render {label}", quiet=as_json) as progress:
                record(files[label], mesh, hand, motion, strategy, mode="overwrite", progress=progress)
        rendered = perf_counter() - started
        picture = folder / "tube.png"
        draw_figure(files, picture, overwrite=True)
        ahead.wait(console.report_compiling)
    with bars.playback_line("playing CC", quiet=as_json) as line:
        played = play_file(files["CC"], connection=connection, watch=line, compiling=console.report_compiling)
    playback = played.as_dict()
    summary, opened = (summarise(files[label]) for label in ("CC", "OC"))
    names = ("frames", "update_rate", "duration", "bytes", "underruns", "board_underruns", "jumps", "array", "clock")
    values = {
        "motion": str(folder / "motion.csv"),
        "open_contours": str(files["OC"]),
        "closed_contours": str(files["CC"]),
        "picture": str(picture),
        "poses": summary["poses"],
        "polylines": summary["polylines"],
        "length_mean": summary["length_mean"],
        "r": summary["r"],
        "render_seconds": rendered,
        **{name: playback[name] for name in names},
        "revisit_rate": playback["revisit_rate"],
        "off_confirmed": playback["off_confirmed"],
        "seconds": perf_counter() - started,
    }
    console.show_values(
        values, as_json=as_json, title="palpate demo: a tube explored by a palm, closed contours played"
    )
    console.conclude(
        f"Closed contours (CC) are {summary['r']:.2f} times as long as open ones (OC): at the same speed they are "
        f"drawn {summary['draw_frequency_median']:.0f} instead of {opened['draw_frequency_median']:.0f} times a second "
        f"(medians of the poses with contours). palpate noise {files['CC']} {files['OC']} compares their noise.",
        as_json=as_json,
    )
