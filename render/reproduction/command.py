"""`palpate reproduce`: the whole evaluation, as a page for people, as Markdown and as JSON."""

import json
from datetime import UTC, datetime
from importlib.metadata import version
from os import W_OK, X_OK, access
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

from ...datasets.storage.durable import write_file
from ..bench.speed import machine_facts
from ..errors import RenderError, StrategyError
from ..hands.hand import Palm
from ..objects.mesh.solid_mesh import MeshObject
from ..reports.report_pages import ReportSection, html_page, markdown_page
from ..runtime.loading_progress import Watch
from ..runtime.warp_start import start_warp
from ..terminal import bars, console
from ..terminal.foreign_text import show_table
from .explorations import FeltLengths, StudySettings, block_ratios, measure_lengths
from .noise_section import noise_section, predicted_noise
from .objects_section import objects_section
from .paper_numbers import BLOCK_COUNT, RATIOS, SOURCE
from .stage_times import BATCH_POSES, LIVE_POSES, MESHES, REPEATS, measure_steps, time_section
from .study_sections import frequency_section, people_section, ratio_section


class Evaluation(NamedTuple):
    """What came out."""

    sections: tuple[ReportSection, ...]
    values: dict
    """For JSON; lengths [m], times [s], frequencies [Hz], levels [dB]."""


def evaluate(settings: StudySettings, watch: Watch) -> Evaluation:
    """Measure everything, in the order of the paper; where nothing is recorded, there is no section of noise."""
    machine = machine_facts("cpu")
    times = {}
    for done, name in enumerate(MESHES):
        watch("time of stages", done, len(MESHES))
        sizes = {"live_poses": LIVE_POSES, "batch_poses": BATCH_POSES, "repeats": REPEATS}
        times[name] = measure_steps(MeshObject.load(name), settings.palm, **sizes)
    parts = [time_section(times, machine["cpu"])]
    if settings.recording:
        parts.append(noise_section(*predicted_noise(settings, watch)))
    lengths = _measure_all(settings, watch)
    watch("pictures", 0, 1)
    ratios = {name: block_ratios(felt) for name, felt in lengths.items()}
    parts += [frequency_section(lengths), objects_section(), ratio_section(ratios, settings), (people_section(), {})]
    about = {
        "version": version("palpate"),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": machine,
        "explorers": settings.explorers,
        "blocks": BLOCK_COUNT,
        "repetitions": settings.repetitions,
        "palm": [settings.palm.width, settings.palm.length],
    }
    found_values = {key: value for _, values in parts for key, value in values.items()}
    return Evaluation(tuple(section for section, _ in parts), {**about, **found_values})


def _measure_all(settings: StudySettings, watch: Watch) -> dict[str, FeltLengths]:
    lengths = {}
    count = len(RATIOS) * settings.explorers
    for place, name in enumerate(RATIOS):
        before = place * settings.explorers
        watch("explorations", before, count)
        lengths[name] = measure_lengths(
            MeshObject.load(name), settings, lambda done, before=before: watch("explorations", before + done, count)
        )
    return lengths


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
        found = evaluate(settings, watch)
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
