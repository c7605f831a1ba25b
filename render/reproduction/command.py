"""`palpate reproduce`: the evaluation as a page for people, as Markdown and as JSON."""

import json
from os import W_OK, X_OK, access
from pathlib import Path
from time import perf_counter

from ...datasets.storage.durable import write_file
from ..errors import RenderError, StrategyError
from ..hands.hand import Palm
from ..reports.report_pages import html_page, markdown_page
from ..runtime.warp_start import start_warp
from ..terminal import bars, console
from ..terminal.foreign_text import show_table
from .evaluation import Evaluation, evaluate
from .explorations import StudySettings
from .paper_numbers import SOURCE
from .predicted_noise import predicted_recordings

NAMES = {"html": "paper.html", "markdown": "paper.md", "json": "paper.json"}
"""Files by what they are."""
TITLE = "The founding paper's evaluation, made again by palpate"
INTRODUCTION = (
    f"The paper that founded intersection strategies is: {SOURCE}. This page puts what palpate gives beside what the "
    "paper reports. No parameter was fitted to an object. But models were chosen from alternatives: of the noise with "
    "figure 4 in view (the transducers' pole, the kind of source, no lag, the number of sources), of the explorations "
    "before their r was known. Each row says so, with the range of its result over the alternatives. What needs people "
    "who feel the contours is not made again; it is listed at the end."
)


def run_reproduce(
    folder: Path,
    explorers: int,
    repetitions: int,
    palm: tuple[float, float] | None,
    recording: float,
    overwrite: bool,
    *,
    as_json: bool,
) -> None:
    """Make the evaluation and write its three files."""
    started = perf_counter()
    settings = StudySettings(explorers, repetitions, Palm() if palm is None else Palm(*palm), recording)
    paths = {kind: folder / name for kind, name in NAMES.items()}
    _require_room(folder, list(paths.values()), overwrite=overwrite)
    start_warp()
    with bars.progress_bar("palpate reproduce", quiet=as_json) as watch:
        found = evaluate(settings, predicted_recordings if recording else None, watch)
    values = {**found.values, "seconds": perf_counter() - started}
    _write(paths, found, values)
    if as_json:
        console.show_values({**values, **{kind: str(path) for kind, path in paths.items()}}, as_json=True, title=TITLE)
        return
    for section in found.sections:
        table = section.tables[0]  # of results; "why they differ" is long, and stands in the pages
        show_table(section.title, [row[:3] for row in table.rows], table.head[:3])
    shown = {kind: str(path) for kind, path in paths.items()}
    console.show_values({**shown, "seconds": values["seconds"]}, as_json=False, title="written")


def _require_room(folder: Path, paths: list[Path], *, overwrite: bool) -> None:
    """Make the folder, and refuse before anything is measured what could not be written after it."""
    there = [path for path in paths if path.exists()]
    if there and not overwrite:
        raise StrategyError(f"{there[0]}: exists; --overwrite replaces it")
    if any(path.is_dir() for path in there):
        raise StrategyError(f"{next(path for path in there if path.is_dir())}: is a folder, not a file to replace")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RenderError(f"{folder}: cannot be made ({error.strerror or error})") from error
    if not access(folder, W_OK | X_OK):
        raise RenderError(f"{folder}: no file can be written there (permission denied)")


def _write(paths: dict[str, Path], found: Evaluation, values: dict) -> None:
    footer = (
        f"Measured on {values['date']} with palpate {values['version']} on {values['machine']['cpu']} by `palpate "
        f"reproduce --explorers {values['explorers']} --repetitions {values['repetitions']} "
        f"--palm {values['palm'][0]:g} {values['palm'][1]:g}`."
    )
    text = {
        "html": html_page(TITLE, INTRODUCTION, found.sections, footer.replace("`", "")),
        "markdown": markdown_page(TITLE, INTRODUCTION, found.sections, footer),
        "json": json.dumps(console.finite(values), indent=1, allow_nan=False) + "\n",
    }
    for kind, path in paths.items():
        try:
            write_file(path, text[kind].encode())
        except OSError as error:
            raise RenderError(f"{path}: cannot be written ({error.strerror or error})") from error
