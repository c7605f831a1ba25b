"""The cases of the sweep benchmark run, small, and make what they time."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import sweep_projection
import sweeps


@pytest.mark.exhaustive
@pytest.mark.parametrize("recipe_count", [1, 3])
def test_overhead_case_sweeps_what_it_renders(recipe_count, device, tmp_path):
    figures = sweeps.overhead(tmp_path, device, 300, 1, recipe_count)
    assert (figures["poses"], figures["recipes"]) == (300, recipe_count)
    assert figures["overhead"] == figures["sweep_seconds"] / figures["render_seconds"] - 1
    assert min(figures["sweep_seconds"], figures["render_seconds"]) > 0


@pytest.mark.exhaustive
def test_metrics_case_compares_as_many_poses(device, tmp_path):
    lines = sweeps.metrics(tmp_path, device, 300, 1)
    assert [figures["processes"] for figures in lines] == [1, 2]
    for figures in lines:
        assert figures["poses"] == 300
        assert figures["share"] == figures["kernel_seconds"] / figures["sweep_seconds"] > 0


@pytest.mark.exhaustive
def test_workers_case_measures_both_sides(tmp_path):
    figures = sweeps.workers(tmp_path, 401, 1)
    assert figures["poses"] == 400
    assert min(figures["sweep_seconds"], figures["apart_seconds"], figures["start_seconds"]) > 0


@pytest.mark.exhaustive
def test_devices_case_goes_from_one_to_all(device, tmp_path):
    one, two = sweeps.devices(tmp_path, [device, device], 300, 1)
    assert (one["devices"], two["devices"], one["speedup"]) == (1, 2, 1.0)
    assert two["speedup"] == one["seconds"] / two["seconds"] > 0


@pytest.mark.exhaustive
def test_finished_case_sweeps_by_the_command(tmp_path):
    figures = sweeps.finished(tmp_path, 5, 1)
    assert figures["recipes"] == 5
    assert min(figures["first_seconds"], figures["again_seconds"]) > 0


@pytest.mark.exhaustive
def test_parent_case_measures_processor_time_a_chunk(device, tmp_path):
    assert 0 < sweeps.parent(tmp_path, device, 300, 1)["parent_seconds_a_chunk"] < 60


@pytest.mark.exhaustive
def test_projection_is_bound_by_the_devices_then_by_the_parent(tmp_path):
    lines = [{"devices": 1, "poses_per_second": 1e8, "start_seconds": 2.0}]
    rows = sweep_projection.table(1e12, lines, 1e-4)
    assert rows[0]["seconds"] == pytest.approx(2 + 1e12 / 1e8)
    assert rows[-1]["seconds"] == pytest.approx(2 + 1e-4 * 1e12 / sweeps.CHUNK_POSES, rel=1e-3)
    assert [row["seconds"] for row in rows] == sorted((row["seconds"] for row in rows), reverse=True)
    sweep_projection.draw({"GPU": lines}, 1e12, 1e-4, tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000
