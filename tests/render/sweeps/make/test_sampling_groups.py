"""Sampling metrics and kept focal points of many motions at once: as of each motion alone, and failures stay apart."""

import errno

import h5py
import pytest
from sweep_recipes import explored, made, payloads_of, recipe_of, unit_of

from palpate.render import StrategyError
from palpate.render.motions.numbers import NUMBERS
from palpate.render.sampling import sampler
from palpate.render.sweeps.make import sampling, sampling_groups
from palpate.render.sweeps.make import unsplit as unsplit_module
from palpate.render.sweeps.make.unit_making import make_unit

BOTH = ("sampling", "keep-focal-points")


def made_in(scratch, recipes, groups, device="cpu"):
    """Payloads without seconds, and kept files by their path within the store."""
    result = make_unit(unit_of(recipes, groups, scratch=scratch), device)
    assert result.failed == ()
    return {place: payload | {"seconds": None} for place, payload in payloads_of(result).items()}, files_of(result)


def files_of(result):
    """Values and attributes, digests among them, of the kept files of focal points, by their paths within the store."""
    out = {}
    for name, path in result.files:
        with h5py.File(path) as file:
            values = [file[name][...].tobytes() for name in ("focus/position", "focus/intensity")]
            out[name] = (
                values,
                [{key: str(value) for key, value in file[name].attrs.items()} for name in ("/", "focus")],
            )
    return out


def sampled(*motions, **options):
    """Recipes of motions and of two sampling strategies."""
    return [recipe_of("tube", motion=own, sampling=name, **options) for own in motions for name in ("stm", "capped")]


def touching(*seeds):
    return [{**explored(1.0, seed=seed), "model": "over-array", "explorer": seed + 1} for seed in seeds]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("groups_asked", [BOTH, ("sampling",), ("keep-focal-points",)])
@pytest.mark.parametrize("strategy", ["cc", "corners"])
def test_motions_are_sampled_together_as_alone_and_in_blocks(tmp_path, monkeypatch, device, strategy, groups_asked):
    recipes = sampled(*touching(5, 7, 4), strategy=strategy)
    groups, real = [], sampling_groups.motion_groups

    def seen(*args, **options):
        for group in real(*args, **options):
            groups.append(group)
            yield group

    monkeypatch.setattr(sampling_groups, "motion_groups", seen)
    payloads, files = made_in(tmp_path, recipes, groups_asked, device)
    assert [(group.first, group.stop) for group in groups] == [(0, 3), (0, 3)]
    monkeypatch.setattr(sampling_groups, "_is_grouped", lambda *_: False)
    for module in (sampling, sampler):
        monkeypatch.setattr(module, "SPAN_SAMPLES", 3000)
    assert made_in(tmp_path, recipes, groups_asked, device) == (payloads, files)
    assert len(payloads) == 6 * len(groups_asked)
    if "sampling" in groups_asked:
        assert all(
            {*NUMBERS, "samples"} <= own.keys() for (group, _, _), own in payloads.items() if group == "sampling"
        )
        assert any(payload.get("jumps_per_second", 0) > 0 for payload in payloads.values())
    assert len(files) == (6 if "keep-focal-points" in groups_asked else 0)


@pytest.mark.parametrize(("name", "together"), [("stm", True), ("multi-focus", False)])
def test_motions_of_more_focal_points_than_memory_may_hold_are_made_alone(monkeypatch, name, together):
    """Two foci of 10,000 samples a second are 20,000 focal points."""
    monkeypatch.setattr(sampling_groups, "FOCI_AT_ONCE", 19_999)
    seen, real = [], sampling_groups.motion_groups
    monkeypatch.setattr(sampling_groups, "motion_groups", lambda *a, **o: seen.append(1) or real(*a, **o))
    made([recipe_of("tube", motion=touching(5)[0], sampling=name)], BOTH[:1])
    assert bool(seen) == together


def test_a_file_that_cannot_be_written_fails_alone(monkeypatch):
    real, calls = sampling_groups.keep_focal_points, []

    def full(*args):
        calls.append(args)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(*args)

    monkeypatch.setattr(sampling_groups, "keep_focal_points", full)
    result = make_unit(unit_of(sampled(*touching(5, 7, 4))[::2], BOTH), "cpu")
    (failed,) = result.failed
    assert (failed.place, failed.is_transient) == (1, True)
    assert failed.message.endswith("(keep-focal-points): No space left on device")
    groups = [row.group for row in result.rows]
    assert (groups.count("sampling"), groups.count("keep-focal-points"), len(result.files)) == (3, 2, 2)


def test_a_motion_that_fails_fails_alone(monkeypatch):
    real, calls = unsplit_module.sample_recipe, []

    def fails(*args, **options):
        calls.append(args)
        if len(calls) == 2:
            raise StrategyError("this motion cannot be sampled")
        return real(*args, **options)

    monkeypatch.setattr(sampling_groups, "motion_groups", lambda *_, **__: (_ for _ in ()).throw(StrategyError("one")))
    monkeypatch.setattr(unsplit_module, "sample_recipe", fails)
    result = make_unit(unit_of(sampled(*touching(5, 7, 4))[::2], ("sampling",)), "cpu")
    (failed,) = result.failed
    assert failed.place == 1
    assert "this motion cannot be sampled" in failed.message
    assert len(result.rows) == 2
