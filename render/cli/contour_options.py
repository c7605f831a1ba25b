"""The commands that make contours, and those that show them, as their options: `option_fields` has typer read them."""

# ruff: noqa: RUF009  # option(), switch() and argument() give fields of dataclasses

from dataclasses import dataclass
from pathlib import Path

from ..errors import StrategyError
from ..output_file import require_output
from ..runtime.worker_devices import has_cuda_driver, worker_devices
from ..validation import require_number
from .inputs import (
    EXPLORATION,
    OBJECTS,
    STRATEGIES,
    require_contour_files,
    require_contour_output,
    require_end,
    require_motion,
    require_object,
    require_output_file,
    require_strategy,
    worker_count,
)
from .option_fields import REQUIRED, Command, argument, option, switch
from .shared_options import (
    ARRAY_OPTION,
    OBJECT_HELP,
    SCALE_HELP,
    STRATEGY_HELP,
    AlignmentOptions,
    AllowCodeOptions,
    ArrayOptions,
    ClockOptions,
    DurationOptions,
    ExplorationOptions,
    HandOptions,
    MeshOptions,
    OverwriteOptions,
    PageOptions,
    PictureOptions,
    PlacementOptions,
    SamplingOptions,
    SlewOptions,
    Three,
    VolumeOptions,
)

PICTURES = (".png", ".svg", ".pdf")
VOXELS = (".npz", ".npy", ".nrrd", ".nii", ".nii.gz", ".nvdb")
CONTOURS = (".h5", ".hdf5")
KEPT = "Contour file, prepared frames, or focal points or drives of a sweep."
COMPRESSION = ("0..9", "Compress the file: 0 not, 9 most.", 0)
FORMATS = {"vtkhdf": ".vtkhdf", "csv": ".csv", "npz": ".npz", "ptlist": ".ptlist", "focal-points": ".bin"}
FIELDS_MOST = 4  # files beside each other in a picture
MOTIONS = (".csv", ".json", ".jsonl", ".ndjson", ".lz", ".npz")
NO_PLACEMENT = {"scale": 1.0, "up": "z", "fit": None, "rotate": (0.0, 0.0, 0.0), "at": None}
OF_A_PAGE = ("poses", "every", "limit", "pressure", "overwrite")
OF_A_SERVER = ("port", "no_browser", "allow_code")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class DemoCommand(Command, ClockOptions, OverwriteOptions):
    """Run the main job: explore the tube for 30 s, render OC and CC, play CC on the emulated array, draw a picture."""

    job = ".render_command:run_demo"
    out: Path = option("FOLDER", "Where the files go; made if it is missing.", Path("palpate-demo"), "-o")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class RenderCommand(
    Command,
    HandOptions,
    AllowCodeOptions,
    OverwriteOptions,
    PlacementOptions,
    VolumeOptions,
    MeshOptions,
    AlignmentOptions,
    ExplorationOptions,
):
    """Render the contours of an object on a moving hand into a contour file."""

    job = ".render_command:run_render"
    source: str = argument("OBJECT", OBJECT_HELP, complete=OBJECTS)
    motion: str = argument(
        "MOTION",
        "CSV or HDF5 of poses, a recording of a hand (Leap, OpenXR, WebXR, MediaPipe), or the word exploration for a "
        "synthetic one.",
        complete=("exploration",),
    )
    out: Path = option("OUT.h5", "Contour file to write.", REQUIRED, "-o")
    strategy: str = option("NAME|FILE", STRATEGY_HELP, "cc", complete=STRATEGIES)
    step: float | None = option(
        "METRES", "Spacing of the grid on the skin, if one is needed; by default a quarter of the focal width."
    )
    flush: float | None = option(
        "METRES",
        "Points within this distance of a patch's plane or side count as on it; by default float32's rounding.",
    )
    bounds: tuple[float, float, float, float, float, float] | None = option(
        "X Y Z X Y Z", "Of a function: lowest and highest coordinates [m]."
    )
    simplify: float | None = option("METRES", "Simplify a mesh within this distance; 0: a quarter of the focal width.")
    object_motion: str | None = option("FILE", "CSV or HDF5 of poses: where the object's middle is, when.")
    side: str | None = option("SIDE", "Which hand of a recording: left, right, or its id.")
    interpolate: float | None = option(
        "METRES",
        "Insert poses until every contour point has one of the next pose within this; 0.0007 (speed / rate) leaves no "
        "hops.",
    )
    device: str = option(
        "DEVICE", "cpu, cuda:0, several with commas between, cuda (all GPUs), or auto: the first GPU if there is one.",
        "auto",
    )  # fmt: skip
    workers: str = option(
        "N", "Workers on each device; auto: one for each core of the CPU, two on a GPU. The file is the same.", "auto"
    )
    memory: int | None = option(
        "MB",
        "Budget of all workers [MB]; by default 200 a CPU worker, 1000 a GPU's, at least 512. Saving holds 256 more.",
        low=5,
    )
    gzip: int = option(*COMPRESSION, low=0, high=9)
    resume: bool = switch("Go on with an interrupted rendering.", "--resume")
    strict: bool = switch("Exit with 1 if no pose has a contour.", "--strict")

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        if self.resume and self.overwrite:
            raise StrategyError("--resume and --overwrite exclude each other")
        require_end(self.out, CONTOURS, "a contour file")
        require_contour_output(self.out, replaces=self.resume or self.overwrite)
        if not has_cuda_driver():  # else Warp is asked, which takes longer
            worker_devices(self.device, worker_count(self.workers))
        if self.simplify is not None and not 0 <= self.simplify < float("inf"):  # a NaN compares false
            raise StrategyError(f"--simplify must be a length in metres of 0 or more, not {self.simplify}")
        require_object(self.source)
        require_motion(self.motion)
        require_strategy(self.strategy)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class VoxeliseCommand(Command, PlacementOptions, OverwriteOptions):
    """Turn a mesh into voxels: the way out for open meshes."""

    job = ".conversion_commands:run_voxelise"
    mesh: str = argument("MESH", "Mesh file, or built in; open ones too.", complete=OBJECTS)
    out: Path = option("OUT.npz", "Or .npy, .nrrd, .nii, .nvdb.", REQUIRED, "-o")
    spacing: float = option("METRES", "Distance between voxels.", REQUIRED)
    kind: str = option("KIND", "distance (signed), or occupancy.", "distance", one_of=("distance", "occupancy"))
    sign: str = option(
        "RULE",
        "Inside by crossings, parity, winding; auto: winding if open.",
        "auto",
        one_of=("auto", "crossings", "parity", "winding"),
    )
    device: str = option("DEVICE", "cpu, cuda:0, or auto: the first GPU if there is one.", "auto")

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        if not 0 < self.spacing < float("inf"):  # a NaN compares false
            raise StrategyError(f"--spacing must be a positive length in metres, not {self.spacing}")
        if not self.out.name.lower().endswith(VOXELS):
            raise StrategyError(f"{self.out}: voxels are written to {', '.join(VOXELS)}")
        if self.out.exists() and not self.overwrite:
            raise StrategyError(f"{self.out}: exists; --overwrite replaces it")
        require_object(self.mesh)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class StrategiesCommand(Command, AllowCodeOptions, OverwriteOptions):
    """List strategies and their stages, print one as the JSON that --strategy takes, or draw some side by side."""

    job = ".strategies_command:run_strategies"
    names: list[str] | None = argument(
        "[NAME|FILE]", "Strategies, or JSON files; several with -o.", None, complete=STRATEGIES
    )
    out: Path | None = option("PICTURE", "Draw them, or all: PNG, SVG, PDF.", None, "-o")

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        if self.out is not None:
            require_output_file(self.out, PICTURES, overwrite=self.overwrite)
        elif len(self.names or ()) > 1:
            raise StrategyError("one strategy is printed at a time; with -o PICTURE several are drawn side by side")
        for name in self.names or ():
            require_strategy(name)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class InfoCommand(Command, MeshOptions):
    """Show what is in contours, prepared frames, or what a sweep keeps, or what is wrong with a mesh."""

    job = ".info_command:run_info"
    files: list[Path] = argument("FILE|MESH", KEPT + " Or a mesh, or a built-in object.")
    scale: float | None = option("FACTOR", SCALE_HELP)
    pressure: bool = switch("Of contours, pressure and force at 20 random poses on an emulator, too.", "--pressure")

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        require_contour_files(self.files, also=OBJECTS)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class CheckCommand(Command):
    """Check that a contour file, a sweep's store or what it keeps is whole: exit 0 if it is, 1 if not."""

    job = ".info_command:run_check"
    files: list[Path] = argument("FILE|STORE", KEPT + " Or a sweep's store, or a table.")

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        require_contour_files(self.files)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class FigureCommand(Command, PictureOptions, OverwriteOptions):
    """Draw contours on hand and object at some moments, their length and draw frequency."""

    job = ".figure_command:run_figure"
    files: list[Path] = argument("FILE", "Contour files of one object and motion.")
    out: Path = option("PICTURE", "PNG, SVG or PDF to write.", REQUIRED, "-o")
    times: str | None = option("T,T,..", "Moments to show [s], or pose numbers if there are no times; else chosen.")
    view: str = option("NAME|EL,AZ", "iso, front, back, side, top, palm, or angles in degrees: 30,-45.", "iso")
    array: str | None = option(**ARRAY_OPTION)
    no_array: bool = switch("Leave out the array.", "--no-array")
    label: list[str] | None = option("TEXT", "Name of a file in the picture: one for each file, in their order.")

    def judge(self) -> None:
        """Raise StrategyError for options that exclude each other, and for an output that cannot be written."""
        require_contour_files(self.files)
        if self.no_array and self.array is not None:
            raise StrategyError("--array and --no-array exclude each other: one shows an array, the other none")
        require_output_file(self.out, PICTURES, overwrite=self.overwrite)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class ViewCommand(
    Command, PageOptions, ArrayOptions, AllowCodeOptions, PlacementOptions, AlignmentOptions, OverwriteOptions
):
    """Show renderings in the browser: object, hand, array, contours and the focal point in slow motion.

    The page is served to this machine only, until Ctrl-C. OBJECT MOTION, as `render` takes them, is a preview: whether
    the hand meets the object, with closed contours, before anything is rendered into a file.
    """

    job = ".view_command:run_view"
    files: list[Path] = argument(
        "FILE", "A contour file, two to compare, the store of a sweep; or OBJECT MOTION, a preview."
    )
    export: Path | None = option("PAGE.html", "Write one self-contained page instead, and end.")
    poses: str | None = option("FIRST:STOP", "Only these poses, STOP not included; as 100:200 or 100:.")
    every: int | None = option("N", "Only every N-th of these poses.")
    limit: float | None = option("MB", "Largest page that is written, by default 20.")
    pressure: bool = switch("Predict the pressure on the skin for the page; half a second a pose.", "--pressure")

    @property
    def is_preview(self) -> bool:
        """Whether an object and a motion are given, not files of contours."""
        return len(self.files) == 2 and (str(self.files[1]) == EXPLORATION or self.files[1].suffix.lower() in MOTIONS)

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        if self.is_preview:
            require_object(str(self.files[0]))
            require_motion(str(self.files[1]))
        else:
            if self.part(PlacementOptions) != NO_PLACEMENT or self.alignment is not None:
                raise StrategyError(
                    "--scale, --up, --fit, --rotate, --at and --alignment are of a preview: OBJECT MOTION"
                )
            for file in self.files:
                if len(self.files) > 1 and file.suffix.lower() in MOTIONS and file.exists():
                    raise StrategyError(f"{file} is a motion: a preview takes the object first, then the motion")
            require_contour_files(self.files)
        names = OF_A_PAGE if self.export is None else OF_A_SERVER
        why = "of a page that --export writes"
        if self.export is not None:
            why = "of a page that is served; --export writes one"
        for name in names:
            value = getattr(self, name)
            if value is not None and value is not False:  # 0 is given
                raise StrategyError(f"--{name.replace('_', '-')} is {why}")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class ExportCommand(Command, SamplingOptions, DurationOptions, OverwriteOptions):
    """Write contours, or focal points sampled from them, as a file that other programs open, whole or by range."""

    job = ".conversion_commands:run_export"
    file: Path = argument("FILE", "Contour file; for focal points also those of a sweep.")
    out: Path = option("OUT", "File to write: .vtkhdf, .csv, .npz, .ptlist, .bin.", REQUIRED, "-o")
    to: str | None = option(
        "FORMAT",
        "vtkhdf, csv, npz (contours), ptlist, focal-points (.bin, .csv, .npz); by default as OUT ends.",
        complete=tuple(FORMATS),
    )
    poses: str | None = option("FIRST:STOP", "Only these poses, STOP not included; as 100:200 or 100:.")
    seconds: str | None = option("START:STOP", "Only the poses of this time [s]; as 1.5:3 or :3.")
    every: int = option("N", "Only every N-th of these poses.", 1, low=1)
    scene: bool = switch("Object and hand as further blocks (vtkhdf).", "--scene")
    gzip: int = option(*COMPRESSION, low=0, high=9)

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        require_output(self.out, overwrite=self.overwrite, sources=[self.file])
        if self.to is None and self.out.suffix.lower() not in FORMATS.values():
            ends = ", ".join(FORMATS.values())
            raise StrategyError(f"{self.out}: must end in one of {ends}, or say the format with to=NAME")
        require_contour_files([self.file], takes_points=True)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class FieldCommand(Command, ArrayOptions, SamplingOptions, PictureOptions, OverwriteOptions):
    """Predict how hard ultrasound presses on the palm, in a plane or a volume: the print of a rendering."""

    job = ".prediction_commands:run_field"
    files: list[Path] = argument("FILE", "Contour files; several are drawn at one scale.")
    at: float | None = option("SECONDS", "Instant of the motion that is shown [s].")
    pose: int | None = option("N", "Number of the pose that is shown; by default of longest contours.")
    where: str = option(
        "PLACE",
        "palm (the hand's patches), plane (parallel to the array), or volume.",
        "palm",
        one_of=("palm", "plane", "volume"),
    )
    average: str = option(
        "TIME",
        "cycle: the pose drawn once around; pose: what is played while it is shown; instant: one frame.",
        "cycle",
        one_of=("cycle", "pose", "instant"),
    )
    size: float | None = option("METRES", "Side of a plane or volume [m], by default 0.2, 0.12.")
    spacing: float | None = option("METRES", "Between points [m], by default 0.001, in a volume 0.004.")
    centre: Three | None = option("X Y Z", "Of a plane or volume [m], by default the middle of the palm.")
    resonance: float | None = option(
        "HZ", "Half the bandwidth of resonant transducers [Hz], as 1000; else they follow."
    )
    out: Path | None = option("FILE", "Picture (PNG, SVG, PDF), or numbers (.npz).", None, "-o")
    device: str = option("DEVICE", "Where it is computed: cpu, cuda:0.", "cpu")

    @property
    def draws(self) -> bool:
        """Whether a picture is asked for."""
        return self.out is not None and self.out.suffix.lower() != ".npz"

    def judge(self) -> None:
        """Raise StrategyError for options that exclude each other, or are out of range."""
        require_contour_files(self.files)
        if len(self.files) > FIELDS_MOST:
            raise StrategyError(f"up to {FIELDS_MOST} files are drawn beside each other, not {len(self.files)}")
        if self.at is not None and self.pose is not None:
            raise StrategyError("--at and --pose exclude each other: both choose what is shown")
        if self.where == "palm" and (self.size is not None or self.centre is not None):
            raise StrategyError("--size and --centre are of a plane or volume; a palm has its own")
        if self.size is not None:
            require_number("--size", self.size, 1e-3, 2.0, unit="m")
        for name in ("width", "font_size"):
            if getattr(self, name) is not None and not self.draws:
                raise StrategyError(f"--{name.replace('_', '-')} is of a picture: add -o PICTURE (PNG, SVG or PDF)")
        if self.out is not None:
            require_output_file(self.out, (*PICTURES, ".npz"), overwrite=self.overwrite, sources=self.files)
            if len(self.files) > 1 and not self.draws:
                raise StrategyError(
                    f"{self.out}: numbers are those of one file, not of {len(self.files)}: write one for each"
                )


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class NoiseCommand(Command, ArrayOptions, SamplingOptions, DurationOptions, SlewOptions, OverwriteOptions):
    """Predict how loud renderings are while they play: spectrum, bands, A-weighted level; and listen to them."""

    job = ".prediction_commands:run_noise"
    files: list[Path] = argument("FILE", "Contour files; levels are those less the first one's.")
    source: str = option(
        "KIND",
        "Where noise comes from: beam (virtual sources), or transducers.",
        "beam",
        one_of=("beam", "transducers"),
    )
    sources: int = option("N", "Virtual sources of the beam.", 2000)
    pole: float = option("HZ", "Half the bandwidth of a transducer [Hz].", 1000.0)
    microphone: Three | None = option(
        "X Y Z", "Place of the microphone [m]; by default 7 cm above and 15 cm beside the array."
    )
    wav: bool = switch("Write FILE.wav beside each file, all with one gain.", "--wav")
    out: Path | None = option("PICTURE", "Draw spectra and levels: PNG, SVG or PDF.", None, "-o")
    device: str = option("DEVICE", "Where it is computed: cpu, cuda:0.", "cpu")

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        require_contour_files(self.files, takes_points=True)
        if self.out is not None:
            require_output_file(self.out, PICTURES, overwrite=self.overwrite, sources=self.files)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class TrustCommand(Command):
    """Accept the code that files name, or are, as it is now, and list all that is accepted; nothing is run."""

    job = ".trust_commands:run_trust"
    given = ("files", "remove")
    files: list[str] | None = argument(
        "FILE",
        "Strategy (.json), plan (.toml), Python file, or package.module:function; read what they name first.",
        None,
    )
    remove: list[str] | None = option("FILE|SHA256", "Accept it no longer. May be repeated.")

    def judge(self) -> None:
        """Refuse what names no code by its name."""
        for name in self.files or ():
            if ":" not in name and not Path(name).is_file():
                raise StrategyError(f"{name}: there is no such file")
            if ":" not in name and not name.endswith((".py", ".toml", ".json")):
                raise StrategyError(f"{name}: must be a strategy (.json), a plan (.toml) or Python (.py)")
