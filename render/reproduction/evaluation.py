"""The whole evaluation: everything that is measured, as sections for pages and as values for JSON."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from typing import NamedTuple

from ..acoustics.spectrum import NoiseSpectrum
from ..bench.speed import machine_facts
from ..objects.mesh.solid_mesh import MeshObject
from ..reports.report_pages import ReportSection
from ..runtime.loading_progress import Watch, unwatched
from .construction_section import construction_section
from .explorations import FeltLengths, StudySettings, measure_lengths
from .frequency_section import frequency_section
from .length_ratios import block_ratios
from .noise_recordings import compare_noise
from .noise_section import noise_section
from .objects_section import objects_section
from .paper_numbers import BLOCK_COUNT, RATIOS
from .people_section import people_section
from .ratio_section import ratio_section
from .stage_times import BATCH_POSES, LIVE_POSES, MESHES, REPEATS, measure_steps, time_section


class NoiseRecordings(NamedTuple):
    """Recordings of explorations of the cube with OC and with CC, and what a report says of them."""

    open: Sequence[NoiseSpectrum]
    closed: Sequence[NoiseSpectrum]
    """Recording k of both is of the same exploration."""
    text: str
    """How they were made, in a few sentences."""
    why: dict[str, str]
    """Why each quantity differs from the paper's: see `noise_section`."""


NoiseSource = Callable[[StudySettings, Watch], NoiseRecordings]
"""Makes or predicts the recordings; reports progress to the Watch."""


class Evaluation(NamedTuple):
    """What came out."""

    sections: tuple[ReportSection, ...]
    values: dict
    """For JSON; lengths [m], times [s], frequencies [Hz], levels [dB]."""


def evaluate(settings: StudySettings, noise: NoiseSource | None = None, watch: Watch = unwatched) -> Evaluation:
    """Measure everything, in the order of the paper; without `noise` there is no section of it, and no value."""
    machine = machine_facts("cpu")
    construction, values = construction_section()
    times = {}
    for done, name in enumerate(MESHES):
        watch("time of stages", done, len(MESHES))
        sizes = {"live_poses": LIVE_POSES, "batch_poses": BATCH_POSES, "repeats": REPEATS}
        times[name] = measure_steps(MeshObject.load(name), settings.palm, **sizes)
    parts = [(construction, values), time_section(times, machine["cpu"])]
    if noise is not None:
        found = noise(settings, watch)
        parts.append(noise_section(compare_noise(found.open, found.closed), found.text, found.why))
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
