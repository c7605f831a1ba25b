"""`palpate view --export`: contour files -> one page."""

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from ....datasets.storage.durable import write_file
from ...contour_input import takes_batches
from ...errors import StrategyError, ViewError
from ...exports.pose_choice import Ends, choose_poses
from ...output_file import require_output
from ...playback.placed_arrays import PlacedArray, load_rig
from ...sampling.strategy import SamplingStrategy
from ...user_warnings import warn_user
from ...validation import require_number, require_path, value_text
from ..file_scene import FileScene
from ..packing import Packer
from ..pressure_print import PressurePrinter, pack_prints
from .document import document
from .payload import describe_page, file_names, pack_file

LIMIT = 20.0
"""Largest page [MB] unless another limit is given: what a mail takes, and what a phone opens."""
FILES_MOST = 2
SAMPLED = 64  # poses of a file that the size of a page of many more is estimated from
MARGIN = 0.85  # of what an estimate promises to fit


@takes_batches
def export_page(
    files: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    poses: Ends = None,
    every: int | None = None,
    limit: float = LIMIT,
    overwrite: bool = False,
    title: str | None = None,
    sampling: SamplingStrategy | None = None,
    array: str | Sequence[PlacedArray] = "emulator",
    pressure: bool = False,
) -> dict[str, Any]:
    """Write one page that shows a contour file, or two side by side, in any browser; it holds everything itself.

    poses: range "FIRST:STOP" of the files' poses; None: all. every: each n-th of them. limit: size that the page must
    not exceed [MB]. title: of the page; None: what was rendered. sampling: how the focal point draws. array: shown
    under the hand, by name or JSON file (`load_rig`), or arrays as they are placed. pressure: predict for each pose how
    strongly the arrays press on the skin (half a second of CPU a pose), for a layer of the page.

    Positions are rounded to 0.01 mm. Returns `page` (its path), `bytes`, `poses` (how many it holds of each file).
    Raises ViewError for a page that is larger than the limit (the message says what would fit) or cannot be written;
    StrategyError for poses that are not there; ContourFileError for files that cannot be read.

    >>> from palpate.render import export_page, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> facts = export_page(path, "cube.html", overwrite=True)
    >>> facts["poses"], facts["bytes"] < 1_500_000
    ([1], True)
    """
    listed = [files] if isinstance(files, str | Path) else list(files)
    if not 1 <= len(listed) <= FILES_MOST:
        raise StrategyError(f"a page shows one contour file or two, not {len(listed)}")
    paths = [require_path(path, "a contour file") for path in listed]
    page = require_path(out, "the page")
    if page.suffix.lower() not in (".html", ".htm"):
        raise StrategyError(f"{page}: must end in .html or .htm, not {value_text(page.suffix)}")
    require_output(page, overwrite=overwrite, sources=paths)
    require_number("limit", limit, 0.001, 1e6, unit="MB")
    arrays = load_rig(array) if isinstance(array, str) else array
    printer = PressurePrinter(arrays, sampling) if pressure else None
    with ExitStack() as opened:
        scenes = [opened.enter_context(FileScene(path)) for path in paths]
        chosen = [
            choose_poses(scene.file, poses, every=1 if every is None else every, may_lack=True) for scene in scenes
        ]
        _require_done(scenes, chosen)
        for scene in scenes:
            if not scene.file.polyline_count:
                warn_user(f"{scene.path} holds no contour: the page shows object and hand only")

        def made(rows: list[list[int]]) -> bytes:
            return _document(scenes, rows, arrays, title, sampling, printer).encode()

        content = _fitting(made, chosen, round(1e6 * limit), page)
    try:
        write_file(page, content)
    except OSError as error:
        raise ViewError(f"{page}: the page cannot be written ({error.strerror or error})") from error
    return {"page": str(page), "bytes": len(content), "poses": [len(rows) for rows in chosen]}


def _require_done(scenes: list[FileScene], chosen: list[range]) -> None:
    """Refuse a file of whose chosen poses none is rendered; warn of one that is not finished."""
    for scene, rows in zip(scenes, chosen, strict=True):
        if scene.is_sealed:
            continue
        done = sum(scene.is_done(row) for row in rows)
        if not done:
            raise StrategyError(
                f"{scene.path}: none of the chosen poses is rendered yet; palpate render --resume goes on"
            )
        warn_user(f"{scene.path}: is not finished: the page shows contours of {done} of {len(rows)} chosen poses")


def _fitting(made: Callable[[list[list[int]]], bytes], chosen: list[range], limit: int, page: Path) -> bytes:
    """The page, or ViewError if it is over the limit: of many poses at once, where a few show that it will be."""
    fixed = len(made([spread(rows, 1) for rows in chosen]))
    pose_count, few = sum(map(len, chosen)), [spread(rows, SAMPLED) for rows in chosen]
    if pose_count > 2 * sum(map(len, few)):
        estimate = (len(made(few)) - fixed) * pose_count / sum(map(len, few))
        if estimate > 2 * max(limit - fixed, 0):
            raise _too_large(page, f"about {(fixed + estimate) / 1e6:.3g}", fixed, fixed + estimate, limit, chosen)
    content = made([list(rows) for rows in chosen])
    if len(content) > limit:
        raise _too_large(page, f"{len(content) / 1e6:.3g}", fixed, len(content), limit, chosen)
    return content


def _too_large(page: Path, size: str, fixed: float, whole: float, limit: int, chosen: list[range]) -> ViewError:
    share = MARGIN * (limit - fixed) / max(whole - fixed, 1.0)
    fits = what_fits(max(chosen, key=len), share) if share > 0 else ""
    way = f"{fits} would fit" if fits else f"none of its poses fits, as every page has {fixed / 1e6:.3g} MB besides"
    return ViewError(
        f"{page}: would have {size} MB, and the limit is {limit / 1e6:.3g} MB; {way}; "
        f"limit={math.ceil(whole / MARGIN / 1e6)} admits it"
    )


def _document(
    scenes: list[FileScene],
    rows: list[list[int]],
    arrays: Sequence[PlacedArray],
    title: str | None,
    sampling: SamplingStrategy | None,
    printer: PressurePrinter | None,
) -> str:
    packer = Packer()
    files = [
        pack_file(scene, list(poses), packer, name=name, sampling=sampling)
        for scene, poses, name in zip(scenes, rows, file_names(scenes), strict=True)
    ]
    if printer is not None:
        for file, print_ in zip(files, pressure_of(scenes, rows, printer, packer), strict=True):
            file["pressure"] = print_
    described = describe_page(files, scenes, [placed.model for placed in arrays], packer, title)
    return document(described, packer.text(), described["title"])


def pressure_of(
    scenes: list[FileScene], rows: list[list[int]], printer: PressurePrinter, packer: Packer
) -> list[dict[str, Any]]:
    """Prints of pressure on the skin at the chosen poses of each file.

    Colours go up to the strongest place of the pose, in whichever file; of files with other poses, of all poses.
    """
    prints = [
        [printer.compute(scene.moment(row), "skin") for row in poses] for scene, poses in zip(scenes, rows, strict=True)
    ]
    peaks = [[each.peak for each in own] for own in prints]
    if all(poses == rows[0] for poses in rows):
        peaks = [[max(same) for same in zip(*peaks, strict=True)]] * len(rows)
    else:
        peaks = [[max(map(max, peaks))] * len(poses) for poses in rows]
    return [pack_prints(own, peak, packer) for own, peak in zip(prints, peaks, strict=True)]


def spread(chosen: range, most: int) -> list[int]:
    """At most `most` of the chosen poses, evenly spread."""
    rows = np.unique(np.linspace(0, len(chosen) - 1, min(most, len(chosen))).astype(np.int64))
    return [chosen[int(row)] for row in rows]


def what_fits(chosen: range, share: float) -> str:
    """The arguments for those of the chosen poses that a page of `share` of the size holds; "" where it holds none.

    >>> what_fits(range(0, 1000), 0.25)
    'every=4, or poses="0:250"'
    """
    count = math.floor(len(chosen) * share)
    if count < 1:
        return ""
    every = chosen.step * math.ceil(len(chosen) / count)
    step = f" with every={chosen.step}" if chosen.step > 1 else ""
    return f'every={every}, or poses="{chosen.start}:{chosen.start + count * chosen.step}"{step}'
