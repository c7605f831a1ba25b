"""The file of a live run: a contour file with what was emitted beside what rendering its poses gives again.

The contours come from rendering the run's poses as `record` does. The focal points are those of the run itself, so
`LiveRecording.compare` can find whether rendering and sampling the poses gives each of them again, bit for bit.
"""

import json
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from ...datasets.contour_file.header_live import RecordedRun
from ...datasets.contour_file.live_summary import summarise_run
from ...datasets.contour_file.reader import ContourFile
from ...datasets.contour_file.writer import ContourWriter
from ...datasets.errors import ContourFileError
from ...datasets.json_text import parse_json
from ...datasets.motions.hand_motion import HandMotion
from ...datasets.storage.schema import LIVE_MARKS
from ..hands.hand import Hand
from ..hands.plane_hand import PlaneHand
from ..intersection.batch_rendering import rendered_chunks
from ..intersection.file_recording import file_header, metrics_of
from ..intersection.job import job_of
from ..objects.solid import Solid
from ..playback.focal_points import ContourSource, sampling_of_run
from ..sampling.metrics import FocalPoints
from ..sampling.sampler import Sampler
from ..sampling.strategy import SamplingStrategy
from ..strategies.intersection_strategy import IntersectionStrategy

EMITTED, DROPPED, HELD, FADED = range(len(LIVE_MARKS))
"""Marks of a sample: emitted as sampled; dropped, it came too late; held, nothing came in time, and the array held the
frame before; faded, nothing came for longer, so the writer faded or was silent in its place."""


@dataclass
class LiveSegment:
    """A live run of one object, hand, strategy and sampling, from its first pose to its last sample."""

    solid: Solid
    hand: Hand
    strategy: IntersectionStrategy
    sampling: SamplingStrategy
    hold: float
    """Age from which a pose faded [s], as `Instant` had it."""
    time: np.ndarray
    """When each pose took effect [s]: its first sample / update rate, the first at 0; float64, shape [pose]."""
    pose: np.ndarray
    """Hand frame -> array frame, float32, shape [pose, 7]."""
    patch_pose: np.ndarray | None
    """Of an articulated PlaneHand: patch -> hand frame, float32, shape [pose, patch, 7]."""
    stamp: np.ndarray
    """When the hand was there [s], on the host's clock, 0 when sample 0 was due; float64, shape [pose]."""
    emitted: np.ndarray
    """When the pose's first focal point was emitted [s], same clock; NaN if it never was, or that is not known."""
    position: np.ndarray
    """[m], array frame, float32, shape [sample, 3], with several foci [sample, focus, 3]."""
    intensity: np.ndarray
    """As sampled, float32, shape [sample] or [sample, focus]."""
    gain: np.ndarray | None
    """The person's intensity, applied after sampling, float32, shape [sample]; None: 1 throughout."""
    mark: np.ndarray
    """What became of a sample: EMITTED, DROPPED, HELD or FADED, uint8, shape [sample]."""
    events: list[tuple[float, str, str]]
    """Time [s], kind and text of whatever happened."""
    source: str
    array: str
    lead: float
    """How long before it was due a focal point was drawn at most [s]."""
    realtime: bool
    emission: str
    """Whose times `emitted` are: "board" or "estimate"."""

    def run(self) -> RecordedRun:
        """Description of the run, for its file."""
        return RecordedRun(
            sampling=self.sampling.described(),
            update_rate=float(self.sampling.update_rate),
            hold=float(self.hold),
            samples=len(self.intensity),
            foci=self.sampling.foci,
            source=self.source,
            array=self.array,
            lead=float(self.lead),
            realtime=bool(self.realtime),
            emission=self.emission,
        )

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays of /live by name."""
        arrays = {
            "stamp": np.asarray(self.stamp, np.float64),
            "emitted": np.asarray(self.emitted, np.float64),
            "position": np.asarray(self.position, np.float32).reshape(-1, 3),
            "intensity": np.asarray(self.intensity, np.float32).reshape(-1),
            "mark": np.asarray(self.mark, np.uint8),
            "events": np.frombuffer(event_lines(self.events), np.uint8),
        }
        return arrays if self.gain is None else arrays | {"gain": np.asarray(self.gain, np.float32)}


def save_segment(path: str | Path, segment: LiveSegment, *, overwrite: bool = False) -> Path:
    """Render a live run's poses into a contour file, and keep what the run itself did beside them; returns its path.

    A kill leaves no half file. Raises ContourFileError for a file that is there unless `overwrite`, or is not written.
    """
    hand = segment.hand
    if segment.patch_pose is not None and isinstance(hand, PlaneHand):
        hand = replace(hand, patch_pose=np.asarray(segment.patch_pose, np.float32))
    job = job_of(segment.solid, hand, HandMotion(segment.time, segment.pose), segment.strategy)
    header = file_header(job.scene, job.motion, job.devices[0])
    header = replace(header, live=segment.run().described(), live_arrays=segment.arrays())
    mode = "overwrite" if overwrite else "create" if Path(path).exists() else "resume"  # of a run that was killed here
    with ContourWriter(path, header, mode=mode) as writer:
        with closing(rendered_chunks(job, writer.missing())) as chunks:
            for chunk in chunks:
                writer.write(chunk.first, chunk.stop, chunk.contours.arrays(), metrics_of(chunk), chunk.timing)
        writer.seal()
    return Path(path)


def event_lines(events: list[tuple[float, str, str]]) -> bytes:
    """Events as a file has them: a line of JSON each. Half a surrogate pair, as in odd names of files, becomes `?`."""
    rows = ([float(time), kind, text.encode(errors="replace").decode()] for time, kind, text in events)
    return "".join(f"{json.dumps(row)}\n" for row in rows).encode()


def events_of(lines: bytes) -> list[tuple[float, str, str]]:
    """Events from the lines of JSON; raises ValueError for anything else."""
    events = [parse_json(line, allow_nan=True) for line in lines.decode().splitlines()]
    if not all(isinstance(own, list) and len(own) == 3 and isinstance(own[0], int | float) for own in events):
        raise ValueError("an event must be a list of a time, a kind and a text")
    return [(float(time), str(kind), str(text)) for time, kind, text in events]


@dataclass(frozen=True)
class LiveComparison:
    """Whether focal points sampled again are those of the run."""

    samples: int
    differing: int
    """Samples of which any bit of a position or an intensity differs."""
    first_differing: int | None

    def __repr__(self) -> str:
        where = "" if self.first_differing is None else f", from sample {self.first_differing} on"
        return f"LiveComparison({self.differing} of {self.samples} samples differ{where})"


class LiveRecording:
    """A live run read from its file; use it in a `with`, or `close()` it.

    Raises ContourFileError for a file that cannot be read, and for one that is not of a live run.

    >>> from palpate.render import Live, LiveRecording
    >>> with Live("tube", record="run.h5", overwrite=True) as live:
    ...     live.wait(0.5)
    >>> with LiveRecording("run.h5") as recording:
    ...     recording.compare().differing  # of all focal points
    0
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.file = ContourFile(path)
        try:
            if (run := self.file.live_run) is None:
                raise ContourFileError(f"{self.path} is a contour file, but not the recording of a live run")
        except ContourFileError:
            self.close()
            raise
        self.run = run
        """Everything of the run but its arrays."""

    def __repr__(self) -> str:
        run = self.run
        return f"LiveRecording({str(self.path)!r}, {self.file.pose_count} poses, {run.samples} samples, {run.array})"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        self.file.close()

    @cached_property
    def sampling(self) -> SamplingStrategy:
        """The run's sampling strategy."""
        strategy = sampling_of_run(self.run)
        if (strategy.foci, strategy.update_rate) != (self.run.foci, self.run.update_rate):
            raise ContourFileError(f"{self.path}: /live: foci and update_rate are not those of sampling")
        return strategy

    @cached_property
    def time(self) -> np.ndarray:
        """When each pose took effect [s], float64, shape [pose]."""
        return self.file.motion()["time"]

    @cached_property
    def pose(self) -> np.ndarray:
        """Hand frame -> array frame, float32, shape [pose, 7]."""
        return self.file.motion()["pose"]

    @cached_property
    def patch_pose(self) -> np.ndarray | None:
        """Of an articulated hand of planes: patch -> hand frame, float32, shape [pose, patch, 7]."""
        rows = self.file.hand_arrays().get("patch_pose")
        return None if rows is None else rows.reshape(self.file.pose_count, -1, 7)

    @cached_property
    def stamp(self) -> np.ndarray:
        """When the hand was there [s], 0 when sample 0 was due; float64, shape [pose]."""
        return self.file.live_rows("stamp")

    @cached_property
    def emitted(self) -> np.ndarray:
        """When a pose's first focal point was emitted [s]; NaN if never, or not known; float64, shape [pose]."""
        return self.file.live_rows("emitted")

    @property
    def latency(self) -> np.ndarray:
        """From the hand's being there to the pose's first focal point [s]; NaN where `emitted` is; shape [pose]."""
        return self.emitted - self.stamp

    @cached_property
    def mark(self) -> np.ndarray:
        """EMITTED, DROPPED, HELD or FADED, uint8, shape [sample]."""
        return self.file.live_rows("mark")

    @cached_property
    def gain(self) -> np.ndarray | None:
        """The person's intensity, float32, shape [sample]; None: 1 throughout."""
        return self.file.live_rows("gain") if self.file.has_live("gain") else None

    @cached_property
    def events(self) -> list[tuple[float, str, str]]:
        """Time [s], kind and text of whatever happened."""
        try:
            return events_of(self.file.live_rows("events").tobytes())
        except ValueError as error:
            raise ContourFileError(f"{self.path}: /live/events cannot be read: {error}") from error

    @property
    def position(self) -> np.ndarray:
        """As sampled [m], float32, shape [sample, 3], or [sample, focus, 3]; read anew each time."""
        return self.focal_points().position

    @property
    def intensity(self) -> np.ndarray:
        """As sampled, float32, shape [sample], or [sample, focus]; read anew each time."""
        return self._intensity(0, self.run.samples)

    def focal_points(self, first: int = 0, stop: int | None = None) -> FocalPoints:
        """Focal points of samples `first` to `stop` (all), as sampled."""
        stop, foci = self.run.samples if stop is None else stop, self.run.foci
        place = self.file.live_rows("position", first * foci, stop * foci)
        return FocalPoints(place if foci == 1 else place.reshape(-1, foci, 3), self._intensity(first, stop))

    def summary(self) -> dict[str, Any]:
        """Numbers of the run, as `summarise_run` gives them: latency [s], samples by mark, seconds with a drop."""
        return summarise_run(self.file) or {}

    def compare(self) -> LiveComparison:
        """Sample the contours of the file, which rendering its poses gave, as the run did, and compare every sample.

        Positions and intensities count as equal if all their bits are.
        """
        differing, first_differing, done = 0, None, 0
        sampler = Sampler(self.sampling, revisits=False)
        for block in ContourSource(self.file, sampler, self.run.duration, block=1 << 16, run=self.run):
            count = len(block.intensity)
            differs = self._differing(block, done, done + count)
            if first_differing is None and differs.any():
                first_differing = done + int(np.flatnonzero(differs)[0])
            differing += int(np.count_nonzero(differs))
            done += count
        if done < self.run.samples:  # the contours ended before the run did: a sample that is missing differs
            first_differing = done if first_differing is None else first_differing
            differing += self.run.samples - done
        return LiveComparison(self.run.samples, differing, first_differing)

    def _differing(self, block: FocalPoints, first: int, stop: int) -> np.ndarray:
        """Which samples of a block differ from those of the run, bool, shape [sample]."""
        own = self.focal_points(first, stop)
        pairs = [(got.view(np.uint32), kept.view(np.uint32)) for got, kept in zip(block, own, strict=True)]
        return np.any([(a != b).reshape(len(a), -1).any(axis=1) for a, b in pairs], axis=0)

    def _intensity(self, first: int, stop: int) -> np.ndarray:
        foci = self.run.foci
        rows = self.file.live_rows("intensity", first * foci, stop * foci)
        return rows if foci == 1 else rows.reshape(-1, foci)
