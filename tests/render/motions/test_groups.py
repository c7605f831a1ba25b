"""Groups of motions: the same contours, focal points and bytes as of each motion alone, however they are grouped."""

import numpy as np
import pytest

from palpate.datasets import HandMotion
from palpate.datasets.errors import MotionError
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.recordings.sample import write_sample
from palpate.device.errors import DeviceError
from palpate.kernels.motions.widening import widen_poses
from palpate.render import (
    Driver,
    DriveStrategy,
    ExploredPoses,
    MeshObject,
    Palm,
    PoseError,
    Sampler,
    SamplingStrategy,
    StrategyError,
    closed_contour,
    dwell_map,
    exploration,
    load_sampling,
    render,
    render_motions,
    sample_bounds,
    static_pose,
)
from palpate.render.intersection.named_inputs import load_hand
from palpate.render.motions import groups as groups_module
from palpate.render.playback.focal_points import ContourSource
from palpate.render.playback.pose_insertion import insert_poses
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import joined
from palpate.render.sweeps.make.sampling import RenderedContours


def trials(count=4, duration=1.0):
    """Explorations that touch the tube within their first half second."""
    return [ExploredPoses.of("tube", duration=duration, seed=seed, explorer=seed + 1) for seed in (5, 7, 4, 6)[:count]]


def grouped(motions, strategy="cc", sampling="stm", **options):
    return list(render_motions("tube", "palm", motions, strategy, sampling, **options))


def played(motion, scene, sampling):
    """What playback makes of a motion: its focal points, what was counted, and its dwell map."""
    sampler = Sampler(sampling)
    source = ContourSource(RenderedContours(scene, motion, "cpu"), sampler)
    blocks = list(source)
    bounds = sample_bounds(motion.time, source.duration, sampling.update_rate)
    return joined(blocks), sampler.count, dwell_map(blocks, motion.pose, bounds, sampling.update_rate)


@pytest.mark.parametrize("sampling", ["stm", "multi-focus", "dtp"])  # dtp: drawn on the host
@pytest.mark.parametrize("strategy", ["oc", "hatch"])
def test_a_group_has_the_focal_points_and_numbers_of_playback(strategy, sampling, device):
    motions, chosen = trials(2), load_sampling(sampling)
    (group,) = grouped(motions, strategy, chosen, device=device)
    for k, motion in enumerate(motions):
        focus, count, dwell = played(motion.motion, group.scene, chosen)
        np.testing.assert_array_equal(group.samples.focus(k).position, focus.position)
        np.testing.assert_array_equal(group.samples.focus(k).intensity, focus.intensity)
        numbers = group.numbers[k]
        assert numbers["samples"] == count.samples == 10_000
        assert numbers["jumps_pose"] == count.jumps["pose"]
        assert numbers["hops_per_second"] == sum(count.hops.values())
        assert numbers["silent_share"] == count.silent / count.samples
        assert numbers["revisit_rate"] == pytest.approx(count.revisit_rate, rel=1e-12)
        assert numbers["dwell_area"] == pytest.approx(dwell.area, rel=1e-9)
        assert numbers["dwell_spread"] == pytest.approx(dwell.spread, rel=1e-9)


def test_groups_do_not_change_results(device):
    motions = trials()
    (whole,) = grouped(motions, device=device)
    parts = grouped(motions, device=device, memory=2**20)
    assert [(part.first, part.stop) for part in parts] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert [numbers for part in parts for numbers in part.numbers] == whole.numbers
    points = np.concatenate([part.samples.position.numpy() for part in parts])
    np.testing.assert_array_equal(points, whole.samples.position.numpy())


def test_contours_are_those_of_render(device):
    motions = trials(2)
    (group,) = grouped(motions, device=device)
    alone = render("tube", "palm", HandMotion(None, np.concatenate([own.motion.pose for own in motions])), "cc")
    for name, values in group.contours.numpy().by_name().items():
        np.testing.assert_array_equal(values, getattr(alone, name))


def test_motions_of_the_host_and_of_the_device_may_be_mixed(device):
    made, pose = trials(2), exploration("tube", 0.5, seed=9, model="around").pose
    rigid = HandMotion(np.cumsum(np.linspace(0.001, 0.03, len(pose))), pose)  # at no rate, and not from 0 on
    (group,) = grouped([made[0], rigid, made[1].motion], device=device)
    assert [own["samples"] for own in group.numbers][::2] == [10_000, 10_000]
    (alone,) = grouped([rigid], device=device)
    assert group.numbers[1] == alone.numbers[0]
    assert group.numbers[2] == grouped(made, device=device)[0].numbers[1]


def test_the_last_pose_lasts_for_the_median_interval_and_a_pose_fades_after_two():
    """Poses every 0.2 s, one of which is missing for 0.6 s: silence from 0.4 s and a fade of 0.02 s after it on."""
    time = np.array([0.0, 0.2, 0.4, 0.6, 1.2, 1.4])
    motion = HandMotion(time, np.tile(static_pose([0, 0, 0.2]).pose, (6, 1)))
    ((numbers,),) = (group.numbers for group in render_motions("cube", "palm", [motion], "cc", "stm"))
    assert numbers["samples"] == 16_000
    assert numbers["silent_share"] == pytest.approx((1.2 - 1.02) / 1.6, abs=2e-4)


def test_a_group_that_does_not_fit_is_halved(monkeypatch, device):
    (whole,) = grouped(trials(), device=device)
    real = groups_module.MotionGroup.__post_init__

    def scarce(group):
        if len(group.motions) > 1:
            raise RuntimeError("Failed to allocate 1 bytes")
        real(group)

    monkeypatch.setattr(groups_module.MotionGroup, "__post_init__", scarce)
    parts = grouped(trials(), device=device)
    assert [(part.first, part.stop) for part in parts] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert [numbers for part in parts for numbers in part.numbers] == whole.numbers


def test_one_motion_that_does_not_fit_and_other_errors_are_raised(monkeypatch):
    def fail(_):
        raise RuntimeError("something else")

    monkeypatch.setattr(groups_module.MotionGroup, "__post_init__", fail)
    with pytest.raises(RuntimeError, match="something else"):
        grouped(trials())
    monkeypatch.setattr(groups_module.MotionGroup, "__post_init__", lambda _: (_ for _ in ()).throw(MemoryError()))
    with pytest.raises(MemoryError):
        grouped(trials(1))


def test_one_motion_that_takes_more_than_the_budget_has_a_group_of_its_own():
    motions = [ExploredPoses.of("tube", duration=10.0, seed=5, explorer=6)] * 2
    parts = grouped(motions, "smooth", memory=2**20)
    assert [(part.first, part.stop) for part in parts] == [(0, 1), (1, 2)]
    assert parts[0].contours.point_count * 28 > 2**20


def test_groups_have_no_more_rows_than_a_call_can_number(monkeypatch):
    motions = trials()
    (whole,) = grouped(motions)
    monkeypatch.setattr(groups_module, "ROWS_MOST", 20_000)  # samples of two of the motions
    parts = grouped(motions)
    assert all(part.stop - part.first <= 2 for part in parts)
    assert [numbers for part in parts for numbers in part.numbers] == whole.numbers


def test_stages_of_a_users_own_see_one_motion_at_a_time(monkeypatch):
    monkeypatch.setattr(groups_module, "has_own_stages", lambda strategy: True)
    parts = grouped(trials())
    assert [(part.first, part.stop) for part in parts] == [(0, 1), (1, 2), (2, 3), (3, 4)]


def test_poses_are_inserted_motion_by_motion_where_a_users_own_stage_may_go_by_rows(monkeypatch):
    monkeypatch.setattr(groups_module, "has_own_stages", lambda strategy: True)
    counts, make = [], groups_module.denser_motions
    monkeypatch.setattr(
        groups_module,
        "denser_motions",
        lambda scene, motions, *rest, **options: counts.append(len(motions)) or make(scene, motions, *rest, **options),
    )
    assert [(part.first, part.stop) for part in grouped(trials(3), interpolate=2e-3)] == [(0, 1), (1, 2), (2, 3)]
    assert counts == [1, 1, 1]


@pytest.mark.parametrize("cells", [{}, {"strategy": DriveStrategy(slew=0.01), "update_rate": 10e3}])
def test_frames_are_those_that_the_driver_makes_of_each_motion(cells, device):
    (group,) = grouped(trials(2, duration=0.5), device=device, memory=2**23)
    blocks = [packed.frames[0].numpy() for packed in group.frames(Driver("pat16", device=device, **cells))]
    frames = np.concatenate(blocks)
    driver, wanted = Driver("pat16", **cells), []
    for motion in range(2):
        driver.reset()
        wanted.append(driver.pack(group.samples.focus(motion)).frames[0].numpy())
    assert len(blocks) in (10, 11, 12)  # of at most 1,024 frames each
    assert frames.shape == (10_000, 512)
    np.testing.assert_array_equal(frames, np.concatenate(wanted))


def test_frames_of_several_focal_points_start_from_rest_at_each_motion(device):
    sampling = preset("multi-focus", update_rate=1000.0)
    (group,) = grouped(trials(2, duration=0.5), sampling=sampling, device=device, memory=2**25)
    packer = Driver("pat16", device=device)
    frames = np.concatenate([packed.frames[0].numpy() for packed in group.frames(packer)])
    for k in range(2):
        (alone,) = grouped(trials(2, duration=0.5)[k : k + 1], sampling=sampling, device=device)
        own = np.concatenate([packed.frames[0].numpy() for packed in alone.frames(packer)])
        np.testing.assert_array_equal(frames[500 * k : 500 * (k + 1)], own)
    assert len(frames) == 1000


@pytest.mark.parametrize("memory", [None, 2**20])
def test_groups_have_the_poses_that_are_inserted_into_each_motion(memory, device):
    motions = trials(3)
    tube, strategy = MeshObject.load("tube"), closed_contour()
    alone = [insert_poses(tube, Palm(), own.motion, strategy, distance=2e-3) for own in motions]
    assert all(motion.inserted > 5 for motion in alone)
    groups = grouped(motions, device=device, memory=memory, interpolate=2e-3)
    assert [(part.first, part.stop) for part in groups] == ([(0, 3)] if memory is None else [(0, 1), (1, 2), (2, 3)])
    denser = [own for part in groups for own in part.motions]
    assert [own.inserted for own in denser] == [motion.inserted for motion in alone]
    pose = np.concatenate([part.pose.numpy() for part in groups])
    np.testing.assert_array_equal(pose, np.concatenate([motion.pose for motion in alone]))
    wanted = [numbers for part in grouped(alone, device=device) for numbers in part.numbers]
    assert [numbers for part in groups for numbers in part.numbers] == wanted


def test_what_cannot_be_a_group_is_refused():
    with pytest.raises(PoseError, match="motion 1: its 2 poses have no times"):
        grouped([trials(1)[0], HandMotion(None, np.tile(static_pose([0, 0, 0.2]).pose, (2, 1)))])
    with pytest.raises(PoseError, match="motion 0: has 1 pose, and a motion has 2 at least"):
        grouped([ExploredPoses.of("tube", duration=0.01)])
    with pytest.raises(PoseError, match="motion 1: must be a HandMotion or ExploredPoses, not 'x'"):
        grouped([trials(1)[0], "x"])
    with pytest.raises(PoseError, match="motions must be a list of motions"):
        grouped(trials(1)[0])
    with pytest.raises(MotionError, match="model must be one of over-array, around, not 'beside'"):
        ExploredPoses.of("tube", model="beside")
    with pytest.raises(MotionError, match=r"no option 'sed' \(did you mean 'seed'\?\); known: duration, ra"):
        ExploredPoses.of("tube", sed=2)
    (group,) = grouped(trials(1), sampling=SamplingStrategy(update_rate=12345.0))
    for number in (-1, 1):
        with pytest.raises(IndexError, match=f"motion {number} is outside the 1 motion sampled, numbered from 0"):
            group.samples.focus(number)
    with pytest.raises(DeviceError, match="12345 Hz"):
        next(group.frames(Driver("pat16")))
    with pytest.raises(StrategyError, match="interpolate must lie in"):
        grouped(trials(1), interpolate=1.0)
    with pytest.raises(StrategyError, match="no device 'cuda:7'"):
        grouped(trials(1), device="cuda:7")
    with pytest.raises(StrategyError, match="memory must be at least 1048576 bytes, not 10"):
        grouped(trials(1), memory=10)


def test_hands_of_many_shapes_are_refused(tmp_path):
    hand = load_hand("planes", None, load_recording(write_sample("openxr", tmp_path / "hand.csv")).held())
    with pytest.raises(StrategyError, match="has a shape for each pose"):
        list(render_motions("tube", hand, trials(1)))


def test_no_motions_make_no_group():
    assert grouped([]) == []


def test_poses_are_widened_exactly(device):
    rows = grouped(trials(1), device=device)[0].pose
    wide = widen_poses(rows, device).numpy()
    assert wide.dtype == np.float64
    np.testing.assert_array_equal(wide, rows.numpy().astype(np.float64))


def test_the_hand_decides_the_dwell_map():
    (small,) = render_motions("tube", Palm(0.03, 0.05), trials(1), "cc")
    (large,) = render_motions("tube", Palm(0.09, 0.15), trials(1), "cc")
    assert small.numbers[0]["dwell_area"] < large.numbers[0]["dwell_area"]
