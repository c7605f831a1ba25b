"""`render`, and the batch of contours that it gives: it knows what it is of, samples, plays, shows and saves itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Unpack, cast, overload

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.motions.hand_motion import HandMotion
from ..batch_rows import BatchRows
from ..contour_batch import ContourBatch, array_names
from ..coordinate_spacing import apart_text, warn_of_spacing
from ..errors import StrategyError
from ..hands.hand import Hand
from ..intersection.batch_rendering import collect, removes_any
from ..intersection.job import job_of
from ..intersection.named_inputs import is_unaligned
from ..intersection.scene import Scene
from ..objects.solid import Solid
from ..strategies.intersection_strategy import IntersectionStrategy
from ..user_warnings import warn_user
from ..validation import require_path
from .tables import ShownPicture, facts_page

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from ...device.report import LiveStatistics
    from ..acoustics.field_metrics import PressureMetrics
    from ..acoustics.spectrum import NoiseSignal
    from ..playback.drive import DriveStrategy
    from ..playback.file_playback import ConnectionFields, Playback
    from ..sampling.strategy import SamplingStrategy
    from .sampled_contours import SampledContours

SHOWN_MOST = 200_000  # poses of a batch that a notebook draws by itself: more take seconds


@dataclass(frozen=True, repr=False, eq=False)
class RenderedBatch(ContourBatch):
    """Contours of a motion, as `render` gives them: a ContourBatch that knows what it is of.

    >>> from palpate.render import Palm, render, static_pose
    >>> batch = render("cube", Palm(), static_pose([0, 0, 0.2]), "cc")
    >>> batch.sample("stm", duration=0.1)
    SampledContours(1000 focal points at 10000 Hz, 0.1 s, 0 silent, 0 jumps, draw frequency 20.6 Hz)
    """

    motion: HandMotion | None = None
    """Poses of the hand, one of each pose of the batch."""
    scene: Scene | None = None
    """Object, hand and strategy."""
    removed: dict[str, np.ndarray] = field(default_factory=dict)
    """Length that each prune stage removed [m], float32, shape [pose], by name."""
    source: Path | None = None
    """Contour file that the batch was read from."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Of a batch that was read from a file: name of the object, kind of the hand."""
    part_of: str = ""
    """What the batch is a part of, where it lost object and hand by that."""

    @property
    def name(self) -> str:
        """Of the object, or of the file."""
        if self.scene is not None:
            return self.scene.solid.name
        return self.names.get("object", "contours")

    @overload
    def __getitem__(self, index: int) -> list[np.ndarray]: ...

    @overload
    def __getitem__(self, index: slice) -> RenderedBatch: ...

    def __getitem__(self, index: int | slice) -> list[np.ndarray] | RenderedBatch:
        """Polylines of one pose [m], each of shape [point, 3]; or the batch of consecutive poses first:stop."""
        return cast("list[np.ndarray] | RenderedBatch", super().__getitem__(index))

    def select(self, first: int, stop: int) -> RenderedBatch:
        """Poses first..stop of a batch on the host, which know their motion, if there is one pose at least.

        Of a file, and of an articulated hand, which has poses of its own, they do not know the scene: they cannot be
        saved or drawn.
        """
        part, scene = super().select(first, stop), self.scene
        if self.motion is None or stop <= first:
            return RenderedBatch(**vars(part))
        motion = self.motion[first:stop]
        if scene is None or scene.hand.pose_count is not None:
            whole = self.part_of or (str(self.source) if scene is None else "a batch of an articulated hand")
            return RenderedBatch(**vars(part), motion=motion, names=self.names, part_of=whole)
        object_pose = None if scene.object_pose is None else scene.object_pose[first:stop]
        removed = {name: length[first:stop] for name, length in self.removed.items()}
        return RenderedBatch(
            **vars(part), motion=motion, scene=replace(scene, object_pose=object_pose), removed=removed
        )

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a contour file, which `palpate info`, `play_file` and `ContourFile` read; returns its path.

        Raises ContourFileError for a file that is there, unless `overwrite`, and for one that cannot be written.
        """
        from ..intersection.file_recording import save_contours

        require_path(path, "the file to save")
        if self.source is not None:
            raise StrategyError(f"this batch was read from {self.source}, which holds all of it: copy that file")
        self._require_array_frame()
        motion = self._known_motion()
        if self.scene is None:
            way = "save or draw the whole, or render the poses of the part"
            part = f"this is a part of {self.part_of}, without object and hand: {way}"
            nothing = "this batch does not know its object and hand, as one does that `render` gives"
            raise StrategyError(part if self.part_of else nothing)
        save_contours(path, self, self.removed, self.scene, motion, overwrite=overwrite)
        return Path(path)

    def figure(self, path: str | Path, **options: Any) -> Path:
        """Draw contours on object and hand, their length and draw frequency, into a PNG, SVG or PDF; returns its path.

        options: times, view, array, width, font_size, overwrite, as for `draw_figure`. A notebook shows the same
        picture of a batch that is a cell's result; `show` gives it other moments.
        Raises StrategyError for another kind of picture, and for one that is there unless `overwrite`.
        """
        from ..reports.contour_figure import draw_figure

        require_path(path, "the picture")
        draw_figure([self], path, **options)
        return Path(path)

    def show(self, times: Sequence[float] | None = None, **options: Any) -> ShownPicture:
        """The picture that `figure` writes, for a notebook, which shows what ends a cell; options: view, array.

        >>> from palpate.render import exploration, render
        >>> batch = render("cube", "palm", exploration("cube", duration=1.0, seed=1), "cc")
        >>> batch.show(view="palm")
        ShownPicture(PNG of 1440 x 724 pixels)
        """
        with TemporaryDirectory(prefix="palpate-") as folder:
            return ShownPicture(self.figure(Path(folder) / "batch.png", times=times, **options).read_bytes())

    @contextmanager
    def as_file(self) -> Iterator[Path]:
        """The contour file that the batch was read from, or one that is removed afterwards."""
        if self.source is not None:
            yield self.source
            return
        with TemporaryDirectory(prefix="palpate-") as folder:
            yield self.save(Path(folder) / "contours.h5")

    def sample(
        self,
        sampling: SamplingStrategy | str | Path = "stm",
        *,
        duration: float | None = None,
        speed: float | None = None,
        update_rate: float | None = None,
    ) -> SampledContours:
        """Focal points of the contours at the sampling strategy's update rate.

        sampling: a strategy, a preset's name or a JSON file. duration: when to stop [s]; a static pose needs it.
        speed [m/s], update_rate [Hz]: instead of the strategy's.
        Raises StrategyError for an unknown strategy or a missing duration, PoseError for poses without times.
        """
        from .sampled_contours import sample_rows

        return sample_rows(self.rows(), sampling, duration, speed=speed, update_rate=update_rate)

    def play(
        self,
        array: str | Path = "emulator",
        *,
        sampling: SamplingStrategy | str | None = None,
        duration: float | None = None,
        repeats: int = 1,
        serial: str | None = None,
        calibration: str | Path | None = None,
        drive: DriveStrategy | None = None,
        watch: Callable[[LiveStatistics, int], object] | None = None,
        **fields: Unpack[ConnectionFields],
    ) -> Playback:
        """Sample and stream the contours to an array, in real time; the array is off afterwards, however it ends.

        array: its name, or a JSON file of several. sampling: by default `stm` at the array's own rate. duration: when
        to stop [s]; a static pose needs it. watch: called at most 10 times a second with the statistics and the number
        of frames in all; what it raises ends the playback. fields: of `Connection`, such as emulate=True, which plays
        to a model of the board, and clock="virtual", by which a model plays as fast as possible. Others, and errors, as
        for `play_file`.
        """
        from ..playback.file_playback import Connection, play_contours
        from ..playback.placed_arrays import load_rig

        if watch is not None and not callable(watch):
            raise StrategyError(f"watch must be a function of statistics and a number of frames, not {watch!r:.60}")
        arrays = load_rig(str(array), serial=serial, calibration=None if calibration is None else Path(calibration))
        given: dict[str, Any] = {"sampling": sampling, "drive": drive, "duration": duration, "repeats": repeats}
        return play_contours(self.rows(), array=arrays, connection=Connection(**fields), watch=watch, **given)

    def view(self, *, port: int | None = None, array: str = "emulator") -> None:
        """Show the contours in the browser until Ctrl-C; port, array, and errors as for `view_files`."""
        from ..view.served.viewing import open_browser, view_files

        view_files([self], port=port, array=array, ready=open_browser)

    def noise(self, **options: Any) -> NoiseSignal:
        """The audible signal at a microphone during playback; options: array, sampling, duration of `predict_noise`."""
        from ..acoustics.prediction import predict_noise

        return predict_noise(self.rows(), **options)

    def field(self, **options: Any) -> PressureMetrics:
        """Pressure on the palm, mean over a sample of the poses; options and errors as for `pressure_metrics`."""
        from ..acoustics.field_metrics import pressure_metrics

        return pressure_metrics(self, **options)

    def to_pandas(self, of: str = "poses") -> pd.DataFrame:
        """A table with one row for each pose, or each point if `of` is "points"; lengths in metres, times in seconds.

        Raises StrategyError for another word, and if pandas is not installed.
        """
        from .tables import point_frame, pose_frame

        motion = self._known_motion()
        if of not in ("poses", "points"):
            raise StrategyError(f"of must be poses or points, not {of!r}")
        return pose_frame(self, motion) if of == "poses" else point_frame(self)

    def to_xarray(self) -> xr.Dataset:
        """What `to_pandas` has of poses, with the dimension `pose` and units as attributes.

        Raises StrategyError if xarray is not installed.
        """
        from .tables import pose_dataset

        return pose_dataset(self, self._known_motion())

    def facts(self) -> dict[str, object]:
        """What the batch is of, and its numbers: lengths [m], draw frequency [Hz] at 7 m/s, pauses included."""
        from ..reports.file_summary import draw_frequencies
        from ..sampling.draw_frequency import pauses_of

        motion, scene = self._known_motion(), self.scene
        length = self.length()
        drawn = length[length > 0]
        frequency = draw_frequencies(drawn, pauses_of(self.numpy())[length > 0])
        return {
            "object": self.name,
            "hand": self.names.get("hand") if scene is None else scene.hand.described()["kind"],
            "poses": len(self),
            "poses_with_contours": len(drawn),
            "duration": motion.duration,
            "length_mean": float(length.mean()) if len(length) else None,
            "length_longest": float(drawn.max(initial=0.0)),
            "draw_frequency": frequency["draw_frequency"],
            "draw_frequency_median": frequency["draw_frequency_median"],
        }

    def _repr_html_(self) -> str | None:
        """Facts and picture, for notebooks, which show this rather than a PNG."""
        return None if self.motion is None else facts_page(repr(self), self.facts(), self._picture)

    def _repr_png_(self) -> bytes | None:
        """The picture, for consoles that show no HTML."""
        return self._picture

    @cached_property
    def _picture(self) -> bytes | None:
        """The figure as PNG; None for batches whose picture takes seconds, or has nothing in it."""
        is_drawable = self.source is not None or (self.scene is not None and self.scene.points == "array")
        if len(self) > SHOWN_MOST or not self.point_count or not is_drawable:
            return None
        return self.show()._repr_png_()

    def _known_motion(self) -> HandMotion:
        """Poses; raises StrategyError for a batch that lost them."""
        if not len(self):
            raise StrategyError("this batch has no poses")
        if self.motion is None:
            raise StrategyError("this batch does not know its hand's motion: `render` gives one that does")
        return self.motion

    def _require_array_frame(self) -> None:
        if self.scene is not None and self.scene.points != "array":
            raise StrategyError(f'this needs points="array", but the batch has points="{self.scene.points}"')

    def rows(self) -> BatchRows:
        """What samplers read: contours and poses, range by range."""
        self._require_array_frame()
        return BatchRows(self.numpy(), self._known_motion(), Path(self.name))


LONG = 1.0  # [s]; a motion that goes on so long without a contour is probably elsewhere


def render(
    solid: Solid | str | Path,
    hand: Hand | str,
    motion: HandMotion | np.ndarray | str | Path,
    strategy: IntersectionStrategy | str = "cc",
    *,
    object_pose: HandMotion | np.ndarray | None = None,
    points: str = "array",
    device: str = "cpu",
    devices: Sequence[str] | None = None,
    memory: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> RenderedBatch:
    """Contours of an object on a moving hand, in memory on the host.

    solid: an object, a mesh of trimesh or PyVista, or a name or file that the command line takes. hand: a hand, or
    "palm", "planes", "skin" or a file. motion: a HandMotion, poses alone, shape [pose, 7], a file, or "exploration".
    strategy: an intersection strategy, its name or its JSON file. object_pose: motion or poses of an object that moves,
    [pose, 7]: where the middle of its bounds is, and its rotation.
    points: "array", or "patch" for points relative to the middle of their patch, along its u, v and n, which float32
    holds to 4e-9 m anywhere (`array_points` gives them in the array's frame in float64). devices: one worker on each
    of these Warp devices, by default one on `device`; the contours are the same. memory: budget of what is being
    computed [byte], results apart, by default 512 MB or more. progress: called with the number of poses done.
    Raises MeshError where the strategy needs a closed surface and the object has none; MotionError with the row of a
    bad pose; StrategyError for an unknown device, too small a budget, or points relative to patches of what is not a
    mesh cut by planes, or has stages that need points in the array's frame. Warns of coordinates that float32 does not
    hold to 1e-5 m, and of a second or more without any contour.

    >>> from palpate.render import Palm, render, static_pose
    >>> batch = render("cube", Palm(0.08, 0.1), static_pose([0, 0, 0.2]), "cc")  # the palm is whole inside the cube
    >>> batch
    RenderedBatch(1 pose, 1 with contours, 1 polyline, 5 points, on the host)
    >>> batch.length().round(3)  # round the palm [m]
    array([0.36], dtype=float32)
    """
    is_raw = is_unaligned(motion)
    means = {"device": device, "devices": devices, "memory": memory}
    report = None if progress is None else lambda done, _: progress(done)
    job = job_of(solid, hand, motion, strategy, object_pose=object_pose, points=points, progress=report, **means)
    scene, motion = job.scene, job.motion
    way = '; points="patch" keeps the points themselves exact, but not the poses'
    warn_of_spacing(scene.solid.name, scene.solid.bounds, motion.pose, scene.object_pose, way=way)
    contours, removed = collect(job)
    is_empty = object_pose is None and not contours.point_count and not removes_any(removed)
    if is_empty and (motion.duration or 0.0) >= LONG:
        way = "; give the recording an alignment: load_recording(path, alignment=...)" if is_raw else ""
        warn_user(apart_text(scene.solid.bounds, motion.pose) + way)
    return RenderedBatch(**vars(contours), motion=motion, scene=scene, removed=removed)


def load_contours(path: str | Path) -> RenderedBatch:
    """The contours of a file, all in memory, as a batch that samples, plays, draws and becomes tables.

    `ContourFile` reads parts of a file that is too large. Raises ContourFileError for a file that cannot be read, or is
    not finished.

    >>> from palpate.render import load_contours, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> load_contours(path).sample("stm", duration=0.1)
    SampledContours(1000 focal points at 10000 Hz, 0.1 s, 0 silent, 0 jumps, draw frequency 20.6 Hz)
    """
    require_path(path, "the contour file")
    with ContourFile(path) as file:
        if not file.sealed:
            raise ContourFileError(f'{path}: is not finished; record(..., mode="resume") finishes it')
        arrays = file.contours(0, file.pose_count)
        names = {"object": str(file.object()["name"]), "hand": str(file.hand.get("kind"))}
    given = {name: arrays[name] for name in array_names() if name in arrays}
    return RenderedBatch(**given, motion=HandMotion.load(path), source=Path(path), names=names)
