"""`palpate render`, contours of an object on a moving hand in a file, and `palpate demo`, the main job in one go."""

from dataclasses import asdict, replace
from pathlib import Path
from time import perf_counter

from ...datasets.contour_file.blocks import work_folder
from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.motions.hand_motion import HandMotion
from ..coordinate_spacing import apart_text, joining_place
from ..errors import StrategyError
from ..hands.hand import Palm
from ..intersection.file_recording import record
from ..intersection.named_inputs import is_recording, load_hand_and_motion, load_solid, simplified
from ..intersection.scene import method_of
from ..motions.explorations.explored import exploration
from ..objects.mesh.placement import Placement
from ..objects.mesh.solid_mesh import MeshObject
from ..playback.file_playback import Connection, play_file
from ..playback.pose_insertion import insert_poses
from ..reports.contour_figure import draw_figure
from ..reports.file_summary import summarise
from ..runtime.warp_start import start_warp
from ..runtime.worker_devices import worker_devices
from ..strategies.intersection_strategy import closed_contour, load_strategy, open_contour
from ..terminal import bars, console
from .contour_options import DemoCommand, RenderCommand
from .inputs import worker_count
from .shared_options import ExplorationOptions, MeshOptions, PlacementOptions, VolumeOptions

FUSED_MOST = 0.2  # share of contours nearer than a focal width to another, from which a rendering is warned of
DEMO_FOLDER = Path("palpate-demo")
"""The demonstration's own folder, whose files it replaces."""
DEMO_FILES = ("motion.csv", "tube-oc.h5", "tube-cc.h5", "tube.png")
SHOWN_OF_RENDERING = ("poses", "poses_drawn", "polylines", "length_mean", "r", "bytes", "poses_rendered", "seconds")


def run_render(job: RenderCommand, *, as_json: bool) -> int:
    """Render, write, summarise."""
    start_warp()
    devices = worker_devices(job.device, worker_count(job.workers))
    strategy = load_strategy(job.strategy, allow_code=job.allow_code)
    changes = {name: getattr(job, name) for name in ("step", "flush") if getattr(job, name) is not None}
    strategy = replace(strategy, **changes)
    with bars.progress_bar(job.source, quiet=as_json) as watch:
        whole = load_solid(
            job.source,
            Placement(**job.part(PlacementOptions)),
            volume=job.part(VolumeOptions),
            mesh=job.part(MeshOptions),
            bounds=job.bounds,
            allow_code=job.allow_code,
            watch=watch,
        )
    solid, detail = simplified(whole, job.simplify)
    if strategy.needs_closed:
        solid.require_closed()
    with bars.progress_bar(job.motion, quiet=as_json) as watch:
        hand, motion = load_hand_and_motion(
            job.hand,
            job.palm,
            job.motion,
            solid,
            exploration_options=job.part(ExplorationOptions),
            side=job.side,
            alignment=job.alignment,
            watch=watch,
        )
    if job.step is not None and method_of(solid, hand, strategy) == "cut":
        raise StrategyError(f"--step is of a grid on the skin, but {solid.name} is a mesh, cut exactly by {job.hand}")
    object_pose = None
    if job.object_motion is not None:
        with bars.progress_bar(job.object_motion, quiet=as_json):
            object_pose = HandMotion.load(job.object_motion)
    started = perf_counter()
    if job.interpolate is not None:
        motion = insert_poses(
            solid, hand, motion, strategy, distance=job.interpolate, object_pose=object_pose, device=devices[0]
        )
    try:
        with bars.progress_bar("poses rendered, saved every 10 s", quiet=as_json) as bar:
            recording = record(
                job.out,
                solid,
                hand,
                motion,
                strategy,
                object_pose=object_pose,
                mode="resume" if job.resume else "overwrite" if job.overwrite else "create",
                devices=devices,
                memory=None if job.memory is None else job.memory * 10**6,
                gzip=job.gzip,
                progress=bar,
            )
    except KeyboardInterrupt:
        message = f"interrupted: {poses_saved(job.out)} of {len(motion)} poses are saved, --resume goes on"
        return console.fail(message, console.FAILED, as_json)
    seconds = perf_counter() - started
    for repair in recording.repairs:
        console.warn(repair)
    with bars.progress_bar(f"reading {job.out}", quiet=as_json):
        summary = summarise(job.out)
    summary |= {"poses_rendered": recording.rendered, "seconds": seconds}
    if detail is not None:
        summary |= {"detail": asdict(detail)}
    is_empty = not summary["poses_drawn"]
    console.show_values(summary, as_json=as_json, title=str(job.out), shown_names=SHOWN_OF_RENDERING)
    if is_empty and any(summary.get("removed_mean", {}).values()):  # they met
        removed = ", ".join(f"{stage} {length:.3g} m" for stage, length in summary["removed_mean"].items() if length)
        console.warn(f"the prune stages removed every contour (mean a pose: {removed})")
    elif is_empty and object_pose is not None:
        console.warn(f"no pose has a contour of the object, which {job.object_motion} moves; see --object-motion")
    elif is_empty:
        tracked = is_recording(job.motion) and job.alignment is None
        moving = f"--at {joining_place(motion.pose)} moves the object into the middle of the motion, --scale its size"
        way = "see --alignment: the recording is in its tracker's frame" if tracked else moving
        console.warn(f"{apart_text(solid.bounds, motion.pose)}; {way}. The same command replaces this empty file")
    elif (share := summary["fused_share"] or 0.0) > FUSED_MOST:
        console.warn(
            f"{100 * share:.0f} % of the contours' length is nearer than a focal width (10 mm at a height of 0.2 m) to "
            "another contour, and a hand feels both as one band. Thicker walls, scale=FACTOR or the prune stage "
            "close-together make them distinct"
        )
    return console.FAILED if is_empty and job.strict else console.DONE


def poses_saved(file: Path) -> int:
    """Poses of a rendering that was stopped which its folder holds, or the file if it is whole; 0 if neither is read.

    The folder goes first: beside it, the file is the old one that the rendering would have replaced.
    """
    folder = work_folder(file)
    try:
        with ContourFile(folder if folder.is_dir() else file) as contours:
            return sum(stop - first for first, stop in contours.done)
    except ContourFileError:
        return 0


def run_demo(job: DemoCommand, *, as_json: bool) -> None:
    """Explore the tube for 30 s, render OC and CC, play CC on the emulated array, draw a picture."""
    started, folder = perf_counter(), job.out
    there = [folder / name for name in DEMO_FILES if (folder / name).exists()]
    if there and folder != DEMO_FOLDER and not job.overwrite:
        raise StrategyError(f"{there[0]}: exists; --overwrite replaces it")
    connection = Connection(clock=job.clock)
    start_warp()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ContourFileError(f"{folder}: cannot be made ({error.strerror})") from error
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
