"""Audible noise of a contour file or of contours in memory, sampled and driven as `play_file` does it."""

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

from ..contour_input import takes_batches
from ..playback.drive import Driver, DriveStrategy
from ..playback.focal_points import ContourRows, contour_source, open_focal_points
from ..playback.placed_arrays import PlacedArray, load_rig
from ..sampling.strategy import SamplingStrategy
from .emission import PlayedFrames, played_frames, require_room
from .noise import NoiseListener, NoiseModel, Progress
from .spectrum import NoiseSignal


@takes_batches
def predict_noise(
    contours: str | Path | ContourRows,
    *,
    array: str | Sequence[PlacedArray] = "emulator",
    sampling: SamplingStrategy | str | None = None,
    drive: DriveStrategy | None = None,
    duration: float | None = None,
    model: NoiseModel | None = None,
    device: str = "cpu",
    progress: Progress | None = None,
) -> NoiseSignal:
    """The audible signal at a microphone while contours are played; only differences between two mean anything.

    Args:
        contours: a contour file or a file of focal points; or contours that are read pose by pose.
        array: name of an array, or several placed arrays (`load_rig`).
        sampling: how contours become focal points; by default stm at the array's own update rate.
        drive: how focal points become drives.
        duration: when to stop [s]; a static pose needs it.
        model: where noise comes from, and the microphone's place.
        device: Warp's.
        progress: called with periods done and periods in all.

    Raises:
        StrategyError: less than 0.1 s, or more frames than fit into 4 GiB, with the limit.

    >>> from palpate.render import NoiseSpectrum, predict_noise, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0.06, 0.2]), "oc").save("cube.h5", overwrite=True)
    >>> heard = predict_noise(path, duration=0.2)
    >>> heard
    NoiseSignal(0.2 s at 40000 Hz)
    >>> clicks = NoiseSpectrum.of(heard)  # an open line jumps from its end to its beginning
    >>> clicks.band(300, 10_000) > clicks.band(40, 300) - 10
    True
    """
    arrays = load_rig(array) if isinstance(array, str) else tuple(array)
    frames = frames_of(contours, arrays, sampling=sampling, drive=drive, duration=duration, device=device)
    listener = NoiseListener([placed.model for placed in arrays], model, device=device)
    return listener.listen(frames, progress)


def frames_of(
    contours: str | Path | ContourRows,
    arrays: Sequence[PlacedArray],
    *,
    sampling: SamplingStrategy | str | None = None,
    drive: DriveStrategy | None = None,
    duration: float | None = None,
    device: str = "cpu",
) -> PlayedFrames:
    """All frames of a playback as the boards play them; arguments and errors as for `predict_noise`."""
    if isinstance(contours, str | Path):
        opening = open_focal_points(Path(contours), sampling, duration, arrays)
    else:
        opening = nullcontext((contour_source(contours, sampling, duration, arrays), None))
    with opening as (source, _):
        models = [placed.model for placed in arrays]
        require_room(source.frame_count, source.update_rate, models)
        for model in models:
            model.divider(source.update_rate)
        driver = Driver(models, drive, update_rate=source.update_rate, device=device)
        return played_frames(source, driver)
