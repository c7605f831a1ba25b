"""Phases of one focus and of four foci a frame: palpate, and where they are installed autd3 and AcousTools.

    python benchmarks/solvers.py                                   # on one core
    python benchmarks/solvers.py --device cuda:0 --foci 1000000 --frames 100000
    python benchmarks/solvers.py --only single                     # or: several

Every round measures each case once, one after the other; figures are medians of the rounds, one line of JSON a case.
On the CPU all run in one thread and its CPU time counts, else wall time until the device is done.
AUTD3 has 249 transducers, the others 256: its time is given for 256. `error`: RMS over the points of a frame of |p|
against the asked ratio, median of the frames, by the case's own model of a transducer (AUTD3: monopoles), phases as
8 bits; for single foci the greatest difference from exact phases [1/256 turn].
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np
import warp as wp
from turns import Case, installed, seconds_by_turns

from palpate.device import array_model
from palpate.kernels.driving.pack import pack_points
from palpate.kernels.driving.solve import solve_points
from palpate.kernels.driving.wave import transducers_on
from palpate.render.playback.drive import boards_on

SOUND_SPEED = 340.0  # [m/s]; AUTD3's
WAVELENGTH = SOUND_SPEED / 40e3  # [m]
RADIUS = 4.5e-3  # [m]
POINTS = 4
MIDDLE_OF_AUTD3 = np.array([0.08636, 0.06604, 0.0])  # [m] of its face, in its own frame


@dataclass(frozen=True)
class Ready:
    """A case with its input: what is timed, and what it gives."""

    run: Callable[[], object]
    turns: Callable[[], np.ndarray] | None
    """Phases of the last run [turns], shape [frame, transducer]; None: it makes none."""
    position: np.ndarray
    """Of the transducers [m]."""
    radius: float = 0.0
    """Of their pistons [m]; 0: monopoles."""


@dataclass(frozen=True)
class FewFrames(Case):
    """A case that solves frames one by one."""

    frames_most: int = 1000
    """Frames of a run: it needs no more for a mean."""


@dataclass(frozen=True)
class Figure:
    """What a case came to."""

    case: str
    frames: int
    microseconds: float
    """A frame of 256 transducers, median."""
    error: float | None
    rounds: int


def grid() -> np.ndarray:
    """16 x 16 transducers, 10.5 mm apart [m]."""
    axis = (np.arange(16) - 7.5) * 10.5e-3
    y, x = np.meshgrid(axis, axis, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.zeros(256)], axis=1).astype(np.float32)


def single_kernel(points: np.ndarray, device: str) -> Ready:
    position, count = grid(), len(points)
    (board,) = boards_on((replace(array_model("emulator"), position=position),), SOUND_SPEED, device)
    on_device, amplitude = wp.array(points, dtype=wp.vec3, device=device), wp.full(count, 1.0, device=device)
    out = wp.empty((count, 512), dtype=wp.uint8, device=device)

    def run() -> None:
        pack_points(on_device, amplitude, board, out=out)
        wp.synchronize_device(device)

    return Ready(run, lambda: out.numpy()[:, 0::2][:, np.argsort(array_model("emulator").wire_order)] / 256.0, position)


def write_floor(points: np.ndarray, device: str) -> Ready:
    """Bytes of the same size set to 0: what writing them costs."""
    out = wp.empty((len(points), 256), dtype=wp.uint8, device=device)

    def run() -> None:
        out.zero_()
        wp.synchronize_device(device)

    return Ready(run, None, grid())


def several_kernel(points: np.ndarray, device: str, *, gs_pat: int, wgs: int) -> Ready:
    position = grid()
    normal = np.tile(np.float32([0, 0, 1]), (256, 1))
    transducers = transducers_on(position, normal, wavelength=WAVELENGTH, radius=RADIUS, device=device)
    on_device = wp.array(points, dtype=wp.vec3, device=device)
    target = wp.full(points.shape[:2], 1.0, dtype=wp.float32, device=device)
    kept: list = [None]

    def run() -> None:
        kept[0] = solve_points(on_device, target, transducers, gs_pat=gs_pat, wgs=wgs)
        wp.synchronize_device(device)

    return Ready(run, lambda: kept[0].numpy(), position, RADIUS)


def single_autd3(points: np.ndarray, device: str) -> Ready:
    from autd3_core import Autd3, Geometry, Velocity
    from autd3_pattern import focus, wavelength

    geometry = Geometry([Autd3()])
    length = wavelength(Velocity.from_m_s(SOUND_SPEED))
    targets = (points.astype(np.float64) + MIDDLE_OF_AUTD3) * 1e3
    phases = [geometry.phase_buffer() for _ in points]

    def run() -> None:
        for target, phase in zip(targets, phases, strict=True):
            focus(geometry, target, length, phase)

    return Ready(run, partial(_autd3_turns, phases), _autd3_position(geometry))


def several_autd3(points: np.ndarray, device: str, *, repeat: int, whole: bool) -> Ready:
    from autd3_core import Autd3, Geometry, Velocity
    from autd3_pattern import wavelength
    from autd3_pattern_holo import AmplitudeTarget, GspatOption, IntensityConstraint, Pa, gspat, gspat_batch

    geometry = Geometry([Autd3()])
    length = wavelength(Velocity.from_m_s(SOUND_SPEED))
    option = GspatOption(repeat=repeat, constraint=IntensityConstraint.Uniform(255), parallel=False)
    targets = [
        [AmplitudeTarget(p, 1300 * Pa) for p in frame] for frame in (points.astype(float) + MIDDLE_OF_AUTD3) * 1e3
    ]
    flat = [target for frame in targets for target in frame]
    phases = [geometry.phase_buffer() for _ in targets]
    levels = [geometry.intensity_buffer() for _ in targets]

    def run() -> None:
        if whole:
            gspat_batch(geometry, flat, length, option, phases, levels)
            return
        for frame, phase, level in zip(targets, phases, levels, strict=True):
            gspat(geometry, frame, length, option, phase, level)

    return Ready(run, partial(_autd3_turns, phases), _autd3_position(geometry))


def _autd3_turns(phases: list) -> np.ndarray:
    return np.array([phase.to_numpy()[0] for phase in phases]) / 256.0


def _autd3_position(geometry: object) -> np.ndarray:
    return np.asarray(geometry[0].positions(), np.float64) * 1e-3 - MIDDLE_OF_AUTD3  # type: ignore[index]


def several_acoustools(points: np.ndarray, device: str, *, solver: str, iterations: int) -> Ready:
    import torch
    from acoustools import Solvers

    torch.set_num_threads(1)
    position = grid()
    place = torch.device("cuda" if device.startswith("cuda") and torch.cuda.is_available() else "cpu")
    board = torch.tensor(position, device=place)
    normals = torch.tensor(np.tile([0, 0, 1.0], (256, 1)), dtype=torch.complex64, device=place)
    columns = torch.tensor(points, device=place).mT.contiguous()
    kept: list = [None]
    solve, wavenumber = getattr(Solvers, solver), 2 * np.pi / WAVELENGTH

    def run() -> None:
        kept[0] = solve(points=columns, board=board, iterations=iterations, norms=normals, k=wavenumber)
        if place.type == "cuda":
            torch.cuda.synchronize()

    # its waves are exp(+j k r), so its drives are the conjugates of ours
    return Ready(run, lambda: np.angle(kept[0].cpu().numpy()[..., 0]) / (2 * np.pi), position, RADIUS)


AUTD3 = ("autd3_pattern", "autd3_pattern_holo")
ACOUSTOOLS = ("acoustools", "torch")
SINGLE = (
    Case("kernel, bytes", single_kernel),
    Case("floor: bytes set to 0", write_floor),
    FewFrames("autd3 focus", single_autd3, AUTD3, 2000),
)
SEVERAL = (
    Case("naive", partial(several_kernel, gs_pat=0, wgs=0)),
    Case("GS-PAT 20", partial(several_kernel, gs_pat=20, wgs=0)),
    Case("GS-PAT 100", partial(several_kernel, gs_pat=100, wgs=0)),
    Case("WGS 20", partial(several_kernel, gs_pat=0, wgs=20)),
    Case("GS-PAT 10, WGS 6", partial(several_kernel, gs_pat=10, wgs=6)),
    FewFrames("autd3 GS-PAT 100", partial(several_autd3, repeat=100, whole=False), AUTD3, 500),
    FewFrames("autd3 GS-PAT 20", partial(several_autd3, repeat=20, whole=False), AUTD3, 500),
    FewFrames("autd3 GS-PAT 100, batch", partial(several_autd3, repeat=100, whole=True), AUTD3, 500),
    FewFrames("AcousTools GS-PAT 20", partial(several_acoustools, solver="gspat", iterations=20), ACOUSTOOLS, 1000),
    FewFrames("AcousTools WGS 20", partial(several_acoustools, solver="wgs", iterations=20), ACOUSTOOLS, 1000),
)


def focal_points(frame_count: int, size: int) -> np.ndarray:
    """Random focal points above an array [m], two wavelengths apart in a frame, shape [frame, size, 3]."""
    rng = np.random.default_rng(4)
    out = np.empty((frame_count, size, 3), np.float32)
    wanting = np.arange(frame_count)
    while len(wanting):
        spread = rng.uniform([-0.05, -0.05, 0.15], [0.05, 0.05, 0.25], (len(wanting), size, 3))
        apart = np.linalg.norm(spread[:, :, None] - spread[:, None], axis=-1) + np.eye(size)
        out[wanting] = spread
        wanting = wanting[apart.min(axis=(1, 2)) < 2 * WAVELENGTH]
    return out


def error_of(ready: Ready, points: np.ndarray, most: int = 200) -> float | None:
    """See the top; of at most so many frames."""
    if ready.turns is None:
        return None
    turns, points = np.asarray(ready.turns(), np.float64)[:most], points[:most].astype(np.float64)
    between = (points if points.ndim == 3 else points[:, None])[:, :, None] - ready.position
    distance = np.linalg.norm(between, axis=-1)
    if points.ndim == 2:
        apart = (turns + distance[:, 0] / WAVELENGTH + 0.5) % 1 - 0.5
        return float(np.abs(apart).max() * 256)
    from scipy.special import j1

    x = np.maximum(2 * np.pi * ready.radius / WAVELENGTH * np.linalg.norm(between[..., :2], axis=-1) / distance, 1e-9)
    waves = 2 * j1(x) / x / distance * np.exp(-2j * np.pi * distance / WAVELENGTH)
    quantised = np.rint(turns * 256) / 256
    reached = np.abs(np.einsum("fmn,fn->fm", waves, np.exp(-2j * np.pi * quantised)))
    return float(np.median((reached / reached.mean(axis=1, keepdims=True)).std(axis=1)))


def measure(cases: tuple[Case, ...], points: np.ndarray, device: str, rounds: int) -> list[Figure]:
    """Figures of the cases whose packages are installed."""
    here = [case for case in cases if not case.missing]
    few = [points[: case.frames_most] if isinstance(case, FewFrames) else points for case in here]
    ready = [case.prepare(part, device) for case, part in zip(here, few, strict=True)]
    seconds = seconds_by_turns([one.run for one in ready], device, rounds)
    figures = []
    for case, one, part, taken in zip(here, ready, few, seconds, strict=True):
        each = taken / len(part) * 1e6 * 256 / len(one.position)
        figures.append(Figure(case.name, len(part), each, error_of(one, part), rounds))
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--foci", type=int, default=20_000, help="frames of one focus")
    parser.add_argument("--frames", type=int, default=1000, help="frames of four foci")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--only", choices=("single", "several"))
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    installed((*SINGLE, *SEVERAL))
    figures = []
    if options.only != "several":
        figures += measure(SINGLE, focal_points(options.foci, 1)[:, 0], options.device, options.rounds)
    if options.only != "single":
        figures += measure(SEVERAL, focal_points(options.frames, POINTS), options.device, options.rounds)
    for figure in figures:
        print(json.dumps(asdict(figure)))


if __name__ == "__main__":
    main()
