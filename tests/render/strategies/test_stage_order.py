"""Orders of transformations: those that make no sense are refused by name, presets are strategies that survive JSON."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from transform_cases import a_setting, assert_valid, batch_of_loops, random_poses, random_regions, run_stage, star

from palpate.render import IntersectionStrategy
from palpate.render.errors import StrategyError
from palpate.render.hands.hand import PatchFrames
from palpate.render.stages.registry import Stage, known_stages
from palpate.render.strategies.intersection_strategy import PRESET_LINES, PRESETS
from palpate.render.strategies.stage_order import require_order

MAKERS = ("ellipse", "circle", "centroid", "hatch", "inset")


@pytest.mark.parametrize(
    ("raw", "prune", "transform", "message"),
    [
        ("section", ("outside",), ("hatch",), '"hatch" fills .*"outside" without "close"'),
        ("contact", (), ("inset",), '"inset" fills .*raw "contact"'),
        ("section", ("outside",), ("close", "hatch", "inset"), '"inset" fills .*"hatch" leaves none'),
        ("section", ("outside",), ("close", "corners", "ellipse"), '"ellipse" draws .*"corners"'),
        ("section", (), ("depth", "smooth", "inset"), '"inset" draws .*"depth"'),
        ("section", ("outside",), ("close", "circle", "edges"), '"edges" tells .*"circle"'),
        ("contact", (), ("edges",), '"edges" tells .*raw "contact"'),
    ],
)
def test_orders_that_make_no_sense_are_refused(raw, prune, transform, message):
    with pytest.raises(StrategyError, match=message):
        require_order(raw, prune, transform)
    with pytest.raises(StrategyError, match=message):
        IntersectionStrategy(raw=raw, prune=prune, transform=transform)


@pytest.mark.parametrize(
    ("raw", "prune", "transform"),
    [
        (
            "section",
            ("outside",),
            ("close", "resample", "smooth", "inset", "hatch", "simplify", "depth", "resample", "corners"),
        ),
        ("section", (), ("hatch",)),
        ("section", ("outside",), ("corners", "edges")),
        ("contact", (), ("ellipse", "hatch")),
        ("section", ("outside",), ("mine", "hatch")),
        ("section", ("outside",), ("close", "corners", "mine", "ellipse")),
    ],
)
def test_orders_that_make_sense_are_taken(raw, prune, transform):
    require_order(raw, prune, transform)


def test_every_preset_has_a_line_of_its_own():
    assert set(PRESET_LINES) == set(PRESETS)
    assert len(set(PRESET_LINES.values())) == len(PRESET_LINES)
    assert all(len(line) < 80 for line in PRESET_LINES.values())


def test_every_stage_says_what_it_does_in_one_line():
    for name, entry in known_stages("transform").items():
        assert 10 < len(entry.line) < 100, name
        assert entry.line != "without description", name


class TwoPatches:
    """Two planes at right angles that move together."""

    patch_count = 2
    pose_count = None

    def frames(self, pose, first=0):
        one = a_setting(pose).frames
        half = np.array([[0.04, 0.04], [0.03, 0.03]])
        return PatchFrames(
            np.concatenate([one.origin, one.origin + 0.05 * one.u], axis=1),
            np.concatenate([one.u, one.v], axis=1),
            np.concatenate([one.v, one.n], axis=1),
            np.concatenate([one.n, one.u], axis=1),
            half,
        )


@pytest.mark.parametrize("name", MAKERS)
def test_what_is_made_lies_in_the_plane_of_its_patch(name, rng):
    batch, setting, _ = random_regions(rng)
    frames = TwoPatches().frames(setting.pose, 0)
    line_pose = np.repeat(np.arange(batch.pose_count), np.diff(batch.pose_start))
    point_pose = np.repeat(line_pose, np.diff(batch.polyline_start))
    local = batch.points - setting.frames.origin[point_pose, 0]
    x = (local * setting.frames.u[point_pose, 0]).sum(axis=1)
    y = (local * setting.frames.v[point_pose, 0]).sum(axis=1)
    other = frames.origin[point_pose, 1] + x[:, None] * frames.u[point_pose, 1] + y[:, None] * frames.v[point_pose, 1]
    patch = np.ones(batch.polyline_count, np.int32)
    moved = replace(batch, points=other.astype(np.float32), polyline_patch=patch)
    first = run_stage(name, batch, setting)
    second = run_stage(name, moved, a_setting(setting.pose, hand=TwoPatches()))
    assert_valid(second, batch.pose_count)
    assert (second.polyline_patch == 1).all()
    line_pose = np.repeat(np.arange(batch.pose_count), np.diff(second.pose_start))
    out_pose = np.repeat(line_pose, np.diff(second.polyline_start))
    height = ((second.points - frames.origin[out_pose, 1]) * frames.n[out_pose, 1]).sum(axis=1)
    assert np.abs(height).max() < 1e-7
    if second.point_count == first.point_count:
        np.testing.assert_allclose(second.length(), first.length(), rtol=1e-4)


def test_a_hole_belongs_to_the_smallest_region_around_it(rng):
    setting = a_setting(random_poses(rng, 1))
    big, hole = star(rng, [0, 0], 0.03), star(rng, [0, 0], 0.018)[::-1]
    island, pit = star(rng, [0, 0], 0.01), star(rng, [0, 0], 0.004)[::-1]
    batch = batch_of_loops([[pit, big, island, hole]], setting.frames)
    out = run_stage("circle", batch, setting)
    want = [shapely.Polygon(island, [pit]).area, shapely.Polygon(big, [hole]).area]
    assert sorted(area_of(line) for line in out.polylines_of(0)) == pytest.approx(want, rel=1e-4)


def area_of(loop):
    middle = loop[:-1].mean(axis=0)
    return 0.5 * np.linalg.norm(np.cross(loop[:-1] - middle, loop[1:] - middle), axis=1).sum()


def test_options_out_of_range_are_refused_by_name():
    with pytest.raises(StrategyError, match=r"hatch\.spacing must lie in 0\.0001\.\.0\.5 m"):
        IntersectionStrategy(prune=("outside",), transform=("close", Stage("hatch", {"spacing": 0.0})))
    with pytest.raises(StrategyError, match=r"ellipse\.of must be one of area, moments, line"):
        IntersectionStrategy(prune=("outside",), transform=("close", Stage("ellipse", {"of": "edges"})))
