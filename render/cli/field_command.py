"""What `palpate field` does: pressure on the palm, a plane or in a volume, mean over frames; numbers and pictures."""

import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.rigid import rotate
from ...datasets.storage.durable import write_file
from ..acoustics.averaged_frames import AVERAGES, frames_of_average
from ..acoustics.drawn_frames import DrawnPose, drawn_pose, drives_of, longest_pose, pose_at
from ..acoustics.field_metrics import planes_of, sampling_for, width_at
from ..acoustics.pressure import PressureSum, complex_drives, follow_drives, require_places
from ..acoustics.radiation import AIR_DENSITY, mean_square
from ..acoustics.sampled_places import sample_plane, sample_volume
from ..acoustics.skin_print import CELLS, SkinPrint, points_along, print_on, unevenness
from ..acoustics.transducers import PRESSURE_AT_1M, Resonance, TransducerSet
from ..errors import StrategyError
from ..output_file import require_output
from ..playback.drive import Driver
from ..playback.placed_arrays import PlacedArray, load_rig
from ..reports.field_figure import FieldPicture, draw_fields, print_picture, volume_picture
from ..reports.picture_page import font_of, width_of
from ..reports.picture_style import require_picture
from ..runtime.warp_start import start_warp
from ..sampling.sampler import has_contours
from ..sampling.strategy import SamplingStrategy
from ..terminal import bars, console
from ..validation import choose, refuse_object, require_number

PLACES = ("palm", "plane", "volume")
FILES_MOST = 4
SIZES = {"plane": 0.2, "volume": 0.12}  # [m]
SPACINGS = {"palm": 1e-3, "plane": 1e-3, "volume": 4e-3}  # [m]
LEFT_OUT = "the hand's shadow and echo; pressures are right to some 50 %, forces to a factor of 2"
SHOWN = (
    "pose", "time", "where", "average", "frames", "points", "pressure_peak", "radiation_peak", "force", "focal_width",
    "share_on_contour", "unevenness", "out", "left_out", "supposed",
)  # fmt: skip


@dataclass(frozen=True)
class FieldJob:
    """All options of `palpate field`."""

    at: float | None
    pose: int | None
    where: str
    average: str
    size: float | None
    spacing: float | None
    centre: tuple[float, float, float] | None
    array: str
    calibration: Path | None
    sampling: str | None
    speed: float | None
    update_rate: float | None
    resonance: float | None
    out: Path | None
    width: str | None
    font_size: float | None
    overwrite: bool
    device: str

    def __post_init__(self) -> None:
        """Raise StrategyError for options that exclude each other, or are out of range."""
        choose("where", self.where, PLACES)
        choose("average", self.average, AVERAGES)
        if self.at is not None and self.pose is not None:
            raise StrategyError("--at and --pose exclude each other: both choose what is shown")
        if self.where == "palm" and (self.size is not None or self.centre is not None):
            raise StrategyError("--size and --centre are of a plane or volume; a palm has its own")
        if self.size is not None:
            require_number("--size", self.size, 1e-3, 2.0, unit="m")
        if self.out is not None:
            require_picture(self.out, overwrite=self.overwrite, also=(".npz",))
        given = [
            option for option, value in (("--width", self.width), ("--font-size", self.font_size)) if value is not None
        ]
        if given and not self.draws:
            raise StrategyError(f"{given[0]} is of a picture: add -o PICTURE (PNG, SVG or PDF)")
        width_of(self.width)
        font_of(self.font_size)

    @property
    def draws(self) -> bool:
        """Whether a picture is asked for."""
        return self.out is not None and self.out.suffix.lower() != ".npz"

    def strategy(self, arrays: tuple[PlacedArray, ...]) -> SamplingStrategy:
        """How contours become focal points."""
        changes = {name: getattr(self, name) for name in ("speed", "update_rate") if getattr(self, name) is not None}
        return replace(sampling_for(self.sampling, arrays), **changes)


class AveragedDrives(NamedTuple):
    """What an array emits in the frames that are averaged, in units of full drive."""

    drawn: DrawnPose
    drive: np.ndarray
    """complex64, shape [frame, transducer]."""
    transducers: TransducerSet
    device: str

    @property
    def field(self) -> PressureSum:
        """Sums its waves."""
        return PressureSum(self.transducers, device=self.device)


def run_field(paths: list[Path], options: dict, *, as_json: bool) -> None:
    """Compute, draw or write, report; several files into one picture."""
    for path in paths:
        refuse_object(path)
    if len(paths) > FILES_MOST:
        raise StrategyError(f"up to {FILES_MOST} files are drawn beside each other, not {len(paths)}")
    job = FieldJob(**options)
    if job.out is not None:
        require_output(job.out, overwrite=job.overwrite, sources=paths)
        if len(paths) > 1 and not job.draws:
            raise StrategyError(f"{job.out}: numbers are those of one file, not of {len(paths)}: write one for each")
    job = replace(job, where=choose("where", job.where, PLACES), average=choose("average", job.average, AVERAGES))
    start_warp()
    arrays = load_rig(job.array, calibration=job.calibration)
    found, shown = [], []
    for path in paths:
        with bars.loading_bar(f"sampling {path}", quiet=as_json):
            emitted = averaged_drives(path, job, arrays)
        with bars.progress_bar("points", quiet=as_json) as bar:
            compute = _in_volume if job.where == "volume" else _on_planes
            values, picture = compute(path, job, emitted, arrays, bar)
        found.append(values)
        shown.append(picture)
    if job.out is not None and job.draws:
        look = {"width": job.width, "font_size": job.font_size}
        draw_fields(shown, job.out, overwrite=job.overwrite, **look)
    if as_json and len(found) > 1:
        console.show_values({"files": found}, as_json=True, title="")
        return
    for path, values in zip(paths, found, strict=True):
        console.show_values(values, as_json=as_json, title=str(path), shown_names=SHOWN)


def averaged_drives(path: Path, job: FieldJob, arrays: tuple[PlacedArray, ...]) -> AveragedDrives:
    """What is emitted, as the boards round it, in the frames that a job asks for."""
    sampling = job.strategy(arrays)
    resonance = None if job.resonance is None else Resonance(pole=job.resonance)
    with ContourFile(path) as file:
        if not file.sealed:
            raise StrategyError(f"{path}: is not finished; palpate render --resume finishes it")
        index = longest_pose(file) if job.pose is None else job.pose
        if job.at is not None:
            index = pose_at(file, job.at)
        drawn = drawn_pose(file, index)
    if not has_contours(drawn.batch) and job.average == "cycle":
        raise StrategyError(f"pose {index} of {path} has no contours, so nothing is drawn: choose another one")
    focus, lead = frames_of_average(path, drawn, job.at, job.average, sampling, arrays, resonance)
    models = [placed.model for placed in arrays]
    driver = Driver(models, update_rate=sampling.update_rate, device=job.device)
    strategy = driver.strategy
    transducers = TransducerSet(models, sound_speed=strategy.sound_speed, piston_radius=strategy.piston_radius)
    drive = complex_drives(drives_of(driver, focus), transducers, quantised=True)
    if resonance is not None:
        drive = follow_drives(drive, resonance, carrier=transducers.carrier, update_rate=sampling.update_rate)
    return AveragedDrives(drawn, drive[lead:], transducers, job.device)


def _facts(path: Path, job: FieldJob, emitted: AveragedDrives) -> dict:
    drawn = emitted.drawn
    return {
        "path": str(path),
        "pose": drawn.index,
        "time": job.at if job.at is not None else drawn.time,
        "where": job.where,
        "average": job.average,
        "frames": len(emitted.drive),
        "out": None if job.out is None else str(job.out),
        "left_out": LEFT_OUT,
        "supposed": emitted.transducers.supposed,
    }


def _on_planes(
    path: Path, job: FieldJob, emitted: AveragedDrives, arrays: tuple[PlacedArray, ...], bar: Callable[[int, int], None]
) -> tuple[dict, FieldPicture]:
    drawn, spacing = emitted.drawn, job.spacing or SPACINGS[job.where]
    if job.where == "palm":
        planes = planes_of(drawn, spacing)
    else:
        x, y = rotate(arrays[0].model.pose[3:], np.eye(3)[:2])
        size = job.size or SIZES["plane"]
        planes = [sample_plane(_centre(job, drawn), x, y, (size, size), spacing)]
    place = require_places(np.concatenate([plane.points for plane in planes]), emitted.transducers)
    skin = print_on(planes, emitted.field, emitted.drive, pressure_at_1m=PRESSURE_AT_1M, progress=bar)
    lines = drawn.polylines()
    values = _facts(path, job, emitted) | _numbers(skin, drawn, emitted, len(place), job.where == "palm")
    title = f"{path.stem}, pose {drawn.index}, {job.where}, mean over {len(emitted.drive)} frames ({job.average})"
    if job.out is not None and not job.draws:
        arrays_kept = {
            "points": place,
            "radiation": np.concatenate([part.ravel() for part in skin.radiation]),
            "shape": np.array([plane.shape for plane in planes]),
            "contour": np.concatenate([*lines, np.zeros((0, 3))]),
            "contour_start": np.cumsum([0, *map(len, lines)]),
        }
        _write_arrays(job.out, arrays_kept, emitted, place)
    return values, print_picture(skin, lines, title=title, focal_width=values["focal_width"])


def _numbers(
    skin: SkinPrint,
    drawn: DrawnPose,
    emitted: AveragedDrives,
    point_count: int,
    is_skin: bool,
) -> dict:
    lines, width = drawn.polylines(), width_at(drawn.pose[:3], emitted.transducers)
    along, _ = mean_square(emitted.field, points_along(lines, width / CELLS), emitted.drive)
    return {
        "points": point_count,
        "pressure_peak": skin.pressure_peak,
        "radiation_peak": skin.radiation_peak,
        "force": skin.force,
        "focal_width": width,
        "share_on_contour": skin.share_within(lines, width) if is_skin else None,
        "unevenness": unevenness(along),
        "pressure_at_1m": PRESSURE_AT_1M,
    }


def _in_volume(
    path: Path, job: FieldJob, emitted: AveragedDrives, arrays: tuple[PlacedArray, ...], bar: Callable[[int, int], None]
) -> tuple[dict, FieldPicture]:
    centre = _centre(job, emitted.drawn)
    size, spacing = job.size or SIZES["volume"], job.spacing or SPACINGS["volume"]
    coordinates = sample_volume(centre.tolist(), size, spacing)
    z, y, x = np.meshgrid(*coordinates[::-1], indexing="ij")
    place = require_places(np.stack([x, y, z], axis=-1).reshape(-1, 3), emitted.transducers)
    mean, most = mean_square(emitted.field, place, emitted.drive, progress=bar)
    radiation = mean * (PRESSURE_AT_1M**2 / (AIR_DENSITY * emitted.transducers.sound_speed**2))
    if job.out is not None and not job.draws:
        kept = dict(zip("xyz", coordinates, strict=True)) | {"radiation": radiation.reshape(x.shape)}
        _write_arrays(job.out, kept, emitted, place)
    title = f"{path.stem}, pose {emitted.drawn.index}, mean over {len(emitted.drive)} frames ({job.average})"
    width = width_at(emitted.drawn.pose[:3], emitted.transducers)
    picture = volume_picture(coordinates, radiation.reshape(x.shape), title=title, focal_width=width)
    values = _facts(path, job, emitted) | {
        "points": len(place),
        "pressure_peak": PRESSURE_AT_1M * float(np.sqrt(most.max())),
        "radiation_peak": float(radiation.max()),
        "focal_width": width,
        "pressure_at_1m": PRESSURE_AT_1M,
    }
    return values, picture


def _centre(job: FieldJob, drawn: DrawnPose) -> np.ndarray:
    return np.asarray(drawn.pose[:3] if job.centre is None else job.centre, float)


def _write_arrays(out: Path, arrays: dict[str, np.ndarray], emitted: AveragedDrives, place: np.ndarray) -> None:
    """Write arrays whole or not at all; of a single frame, its complex pressure [Pa] at the points, too."""
    if len(emitted.drive) == 1:
        parts = [part[0] for _, part in emitted.field.blocks(place, emitted.drive)]
        arrays = arrays | {"pressure": np.concatenate(parts) * np.float32(PRESSURE_AT_1M)}
    content = io.BytesIO()
    np.savez(content, **{name: np.asarray(value) for name, value in arrays.items()})  # type: ignore[arg-type]
    try:
        write_file(out, content.getbuffer())
    except OSError as error:
        raise ContourFileError(f"{out}: cannot be written ({error.strerror or error})") from error
