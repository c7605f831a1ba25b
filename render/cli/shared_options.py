"""Options that several commands have, each declared once; a command has those of the groups that it inherits."""

# ruff: noqa: RUF009  # option(), switch() and argument() give fields of dataclasses

from dataclasses import dataclass
from pathlib import Path

from ..errors import StrategyError
from ..reports.picture_page import font_of, width_of
from .inputs import ARRAYS, HANDS, SAMPLINGS, require_array, require_hand, require_sampling, require_source
from .option_fields import option, switch

UP_AXES = ("x", "y", "z", "-x", "-y", "-z")

Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]

SCALE_HELP = "Factor on the object's coordinates (0.001 for millimetres)."
SOLID_HELP = "Of a mesh: inside by winding number: winding (above 0), even-odd."
OBJECT_HELP = (
    "Mesh (STL, OBJ, PLY, GLB), volume (.npy .npz .nrrd .nii .nvdb), expression (.json), function (module:name), "
    "or built in: cube, sphere, tube, dog, dog-detailed, rock, boulder."
)
STRATEGY_HELP = "By name (palpate strategies lists them), or a JSON file."


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class PlacementOptions:
    """Where the object goes."""

    scale: float = option("FACTOR", SCALE_HELP, 1.0)
    up: str = option("AXIS", "Axis of the file that points up: x, y, z, -x, -y, -z.", "z", one_of=UP_AXES)
    fit: float | None = option("SIZE", "Longest side [m], whatever the scale.")
    rotate: Three = option("X Y Z", "Turn about the array's axes x, y, z in turn [degree].", (0.0, 0.0, 0.0))
    at: Three | None = option("X Y Z", "Where the middle of the object goes [m].")

    def judge(self) -> None:
        """Refuse a size that no object has."""
        if not self.scale > 0 or not (self.fit is None or self.fit > 0):
            from ..objects.mesh.placement import Placement  # it imports NumPy

            Placement(scale=self.scale, fit=self.fit)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class VolumeOptions:
    """How a volume is read."""

    kind: str | None = option(
        "KIND",
        "Of a volume: occupancy, distance, intensity, label.",
        one_of=("occupancy", "distance", "intensity", "label"),
    )
    level: float | None = option("VALUE", "Of an intensity volume: its value on the surface.")
    label: list[int] | None = option("LABEL", "Of a segmented volume: labels that are solid; may be repeated.")
    inside: str | None = option(
        "SIDE", "Of a volume: above or below, where values are solid.", one_of=("below", "above")
    )
    spacing: Three | None = option("X Y Z", "Of a volume, instead of the file's [m].")
    unit: str | None = option("UNIT", "Of a volume file's lengths: m, cm, mm, um.", one_of=("m", "cm", "mm", "um"))


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class MeshOptions:
    """How a mesh is repaired."""

    solid: str | None = option("RULE", SOLID_HELP)
    weld: float | None = option("METRES", "Of a mesh: merge vertices this close.")
    fill_holes: float | None = option("METRES", "Of a mesh: close holes of at most this rim.")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class ExplorationOptions:
    """How a synthetic hand explores the object."""

    duration: float | None = option("SECONDS", "Of a synthetic exploration [s], by default 30.")
    rate: float | None = option("HZ", "Poses a second of an exploration [Hz], by default 90.")
    seed: int | None = option("N", "Seed of an exploration, by default 1.")
    model: str | None = option(
        "NAME", "Of an exploration: over-array (default), a palm that faces the array; around, from every side."
    )
    explorer: int | None = option("N", "Which person explores, by number; by default 1. --seed is the trial.")
    facing: float | None = option(
        "RAD", "Largest angle of the palm's skin to the array's centre in an exploration [rad], by default 1.047."
    )
    workspace: Six | None = option(
        "X Y Z X Y Z", "Lowest and highest corner of where the palm's centre goes in an exploration [m]."
    )


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class AlignmentOptions:
    """Where a recording lies."""

    alignment: Path | None = option("FILE|y-up|unity", "Of a recording: from the tracker's frame to the array's.")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class HandOptions:
    """The hand."""

    hand: str = option(
        "KIND|FILE",
        "palm: one rectangle; planes: palm and phalanges; skin: palpate's own hand; or a file of a hand's mesh.",
        "palm",
        complete=HANDS,
    )
    palm: tuple[float, float] | None = option("WIDTH LENGTH", "Size of the palm [m], by default 0.085 0.085.")

    def judge(self) -> None:
        """Refuse a misspelt hand, and a size of another hand than a palm."""
        require_hand(self.hand)
        if self.palm is not None and self.hand.casefold() != "palm":
            raise StrategyError(f"--palm is the size of --hand palm, which {self.hand} is not")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class AllowCodeOptions:
    """Permission to run code, for one run."""

    allow_code: bool = switch("Run code that strategy, object or plan names: docs/guide/trust.md.", "--allow-code")


ARRAY_OPTION = {
    "metavar": "NAME|RIG",
    "help": "emulator, pat16 (openmpd), sonicsurface, autd3, stratos (ultraleap), or a JSON file of several and their "
    "poses.",
    "complete": tuple(ARRAYS),
}


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class ArrayOptions:
    """The array."""

    array: str = option(default="emulator", **ARRAY_OPTION)
    calibration: Path | None = option("BOARD.pat", "Board file of a pat16: wiring, phase offsets, serial number.")

    def judge(self) -> None:
        """Refuse an array that is not known."""
        require_array(self.array)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class BaudOptions(ArrayOptions):
    """The array, as its frames are made for it."""

    baud: int | None = option("BAUD", "Of a sonicsurface with unusual firmware [Bd].")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class OpenedArrayOptions(BaudOptions):
    """The array that is opened."""

    serial: str | None = option(
        "SERIAL",
        "Which one: its serial number, a sonicsurface's port, an autd3's network interface, a stratos' HOST:PORT.",
    )
    emulate: bool = switch("A model of the array instead of the array.", "--emulate")
    watchdog: bool = switch("A second process switches the array off if this one is killed.", "--watchdog")
    uncalibrated: bool = switch(
        "Play on a real pat16 without its board file: wired as published ones.", "--uncalibrated"
    )


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class TransportOptions:
    """How bytes go to the array."""

    transport: str = option("KIND", "USB writes: queued, sync, or auto.", "auto", one_of=("auto", "sync", "queued"))


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class ClockOptions:
    """The clock of an emulated array."""

    clock: str = option(
        "CLOCK",
        "Of an emulated array: monotonic (real time) or virtual (as fast as it goes).",
        "monotonic",
        one_of=("monotonic", "virtual"),
    )


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class UpdateRateOptions:
    """The update rate."""

    update_rate: float | None = option(
        "HZ", "Focal points a second [Hz]: 40 kHz / n, by default 10000, or the array's."
    )


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SamplingOptions(UpdateRateOptions):
    """How contours become focal points."""

    sampling: str | None = option(
        "NAME|FILE",
        "How contours become focal points: a preset (palpate sampling lists them) or a JSON file; by default stm.",
        complete=SAMPLINGS,
    )
    speed: float | None = option("M/S", "Of the focal point [m/s], by default 7.")

    def judge(self) -> None:
        """Refuse a misspelt preset."""
        require_sampling(self.sampling)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class DurationOptions:
    """The end of what is played."""

    duration: float | None = option(
        "SECONDS", "Stop after this time [s] if the motion has not ended; a static pose needs it."
    )

    def judge(self) -> None:
        """Refuse a time that is none."""
        if self.duration is not None and not 0 < self.duration < float("inf"):  # a NaN compares false
            raise StrategyError(f"duration must be positive, not {self.duration} s")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SlewOptions:
    """How fast phases change."""

    slew: float | None = option("TURNS", "Most that a phase changes in 25 us [turns]; 0.015625 quietens jumps.")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class DriveOptions(SlewOptions):
    """How focal points become drives."""

    amplitude: str = option(
        "KIND",
        "Whether intensity is pressure or force; for strength see --level-max.",
        "pressure",
        one_of=("pressure", "force"),
    )
    solver: str = option(
        "SOLVER",
        "For several focal points at once: naive, gs-pat, wgs, gs-pat+wgs.",
        "gs-pat+wgs",
        one_of=("naive", "gs-pat", "wgs", "gs-pat+wgs"),
    )
    level_max: float = option("SHARE", "Strength of intensity 1, as a share (0..1) of what the array can.", 1.0)
    sound_speed: float = option("M/S", "Speed of sound [m/s]: 331.3 + 0.606 x degrees C.", 343.0)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class LimitOptions:
    """How long and how strongly an array emits."""

    on_time_max: float = option("SECONDS", "Longest emission without a pause of 1 s [s]; 0 lifts the limit.", 120.0)
    duty_max: float = option("SHARE", "Highest mean duty over 10 min, 1 being full drive; 0 lifts the limit.", 0.5)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SourceOptions(AlignmentOptions):
    """The hand that moves now."""

    source: str = option(
        "SOURCE",
        "Where poses come from: exploration, a recording or motion file, udp[:HOST:PORT], ultraleap[:ws://...], or "
        "MODULE:NAME of a source of your own.",
        "exploration",
    )
    side: str | None = option("left|right", "Which hand of the source; by default whichever is seen.")
    prediction: float = option("SECONDS", "Predict poses this far ahead [s], 0.02 for most trackers.", 0.0)
    smoothing: float = option("HZ", "Low-pass of poses [Hz]; it delays them by about 0.2 / HZ.", 0.0)
    lead: float | None = option(
        "SECONDS", "How far ahead focal points go out [s], by default 0.006: as long may the machine stall."
    )
    realtime: bool = switch("Ask for real-time scheduling and locked memory.", "--realtime/--no-realtime", default=True)

    def judge(self) -> None:
        """Refuse a misspelt source."""
        require_source(self.source)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class PageOptions:
    """The page that is served."""

    port: int | None = option("N", "Port of 127.0.0.1 for the page; by default the first free one from 8080 on.")
    no_browser: bool = switch("Print the page's address only, and open nothing.", "--no-browser")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class PictureOptions:
    """The look of a picture."""

    width: str | None = option("METRES|NAME", "Of the picture [m], or single, double, ieee-single, ieee-double.")
    font_size: float | None = option("POINTS", "Of all texts in the picture [pt], by default 8.")

    def judge(self) -> None:
        """Refuse a width or a size that no picture has."""
        width_of(self.width)
        font_of(self.font_size)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class OverwriteOptions:
    """What becomes of a file that is there."""

    overwrite: bool = switch("Replace what is there, once the new file is whole.", "--overwrite")
