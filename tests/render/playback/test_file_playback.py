"""From a file to the bytes that an array takes: sources, repeats, several arrays, point lists."""

import json
from dataclasses import replace

import numpy as np
import pytest
from injected_faults import Fault, FaultKind, inject

from palpate.datasets import HandMotion
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.focus_files.ptlist import write_ptlist
from palpate.device.clock import VirtualClock
from palpate.device.codec import encode_frames
from palpate.device.errors import DeviceBusyError, DeviceLostError, UpdateRateError
from palpate.device.registry import array_model, emulated_backend
from palpate.render import MeshObject, Palm, closed_contour, exploration, record, render
from palpate.render.errors import PoseError, StrategyError
from palpate.render.playback import focal_points as source_module
from palpate.render.playback.drive import Driver, DriveStrategy
from palpate.render.playback.file_playback import Connection, play_file
from palpate.render.playback.focal_points import ContourSource, PointSource, usual_rate
from palpate.render.playback.frames import MadeFrames
from palpate.render.playback.placed_arrays import PlacedArray, load_rig
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import Sampler, joined, sample_contours
from palpate.render.sampling.strategy import AmplitudeModulation, LateralModulation, Pace, SamplingStrategy

VIRTUAL = Connection(clock="virtual")


@pytest.fixture(scope="module")
def tube():
    return MeshObject.load("tube")


@pytest.fixture(scope="module")
def motion(tube):
    whole = exploration(tube.bounds, duration=6.0, rate=90.0, seed=3, model="around")
    return HandMotion(whole.time[:200] - whole.time[0], whole.pose[:200])


@pytest.fixture(scope="module")
def moving(tube, motion, tmp_path_factory):
    path = tmp_path_factory.mktemp("moving") / "tube.h5"
    record(path, tube, Palm(), motion, closed_contour())
    return path


@pytest.fixture(scope="module")
def static(tube, motion, tmp_path_factory):
    path = tmp_path_factory.mktemp("static") / "still.h5"
    length = render(tube, Palm(), motion, closed_contour()).length()
    record(path, tube, Palm(), HandMotion(None, motion.pose[[int(np.argmax(length))]]), closed_contour())
    return path


def focus_of(path, sampling, duration=None):
    sampler = Sampler(sampling)
    with ContourFile(path) as file:
        return joined(list(ContourSource(file, sampler, duration))), sampler


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["stm", "pendulum", "multi-focus", "am-multi-focus"])
@pytest.mark.parametrize("points_a_read", [50, 1 << 16])
def test_a_file_read_in_pieces_is_sampled_as_one(name, points_a_read, moving, motion, tube, monkeypatch):
    monkeypatch.setattr(source_module, "POINTS_A_READ", points_a_read)
    focus, sampler = focus_of(moving, preset(name))
    whole = Sampler(preset(name))
    batch = render(tube, Palm(), motion, closed_contour())
    end = motion.time[-1] + np.median(np.diff(motion.time))
    expected = joined(list(sample_contours([batch], motion.pose, motion.time, end, whole)))
    np.testing.assert_array_equal(focus.position, expected.position)
    np.testing.assert_array_equal(focus.intensity, expected.intensity)
    assert sampler.count == whole.count


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "sampling",
    [
        SamplingStrategy(),
        SamplingStrategy(update_rate=40_000.0),
        SamplingStrategy(am=AmplitudeModulation(frequency=200.0)),
        SamplingStrategy(lm=LateralModulation(frequency=100.0), foci=2),
        preset("stp"),
    ],
)
def test_a_static_pose_is_sampled_once_and_counted_as_if_always(sampling, static):
    focus, sampler = focus_of(static, sampling, duration=12.0)
    whole = Sampler(sampling)
    with ContourFile(static) as file:
        pose = file.motion()["pose"]
        batch = source_module.ContourBatch.from_arrays(file.contours())
    expected = joined(list(sample_contours([batch], pose, np.zeros(1), 12.0, whole)))
    assert len(focus.intensity) == round(12.0 * sampling.update_rate)
    np.testing.assert_allclose(focus.position, expected.position, atol=2e-6)
    np.testing.assert_allclose(focus.intensity, expected.intensity, atol=1e-5)
    assert sampler.count.samples == whole.count.samples
    assert sampler.count.jumps == whole.count.jumps
    assert sampler.count.jump_length == pytest.approx(whole.count.jump_length, abs=1e-6)
    assert sampler.count.cycles == pytest.approx(whole.count.cycles)
    assert sampler.count.revisit_rate == pytest.approx(whole.count.revisit_rate, rel=0.02)


def test_repeats_play_the_same_frames_again_without_the_file(moving):
    sampling = SamplingStrategy(update_rate=2000.0)
    bus = emulated_backend("emulator", clock=VirtualClock(), record=20_000)
    playback = play_file(moving, sampling=sampling, repeats=3, connection=Connection(backend=bus))
    played = bus.board().played[: playback.played.frames]
    once = len(played) // 3
    assert len(played) == 3 * once > 3000
    np.testing.assert_array_equal(played[:once], played[once : 2 * once])
    np.testing.assert_array_equal(played[:once], played[2 * once :])
    assert playback.count.samples == once
    assert playback.as_dict()["repeats"] == 3


def test_a_slew_limit_reaches_across_blocks_and_repeats():
    there_and_back = np.array([[-0.05, 0, 0.2], [0.05, 0, 0.2]] * 1500, np.float32)
    ends_elsewhere = np.concatenate([there_and_back, np.repeat(there_and_back[:2], 1500, axis=0)])
    far = FocalPoints(ends_elsewhere, np.ones(6000, np.float32))
    driver = Driver(array_model("emulator"), DriveStrategy(slew=1e-3), update_rate=10_000.0)
    blocks = list(MadeFrames(PointSource(far, update_rate=10e3), driver, repeats=2))
    wire = np.concatenate([np.frombuffer(block[0], np.uint8).reshape(-1, 512) for block in blocks])
    step = np.abs((np.diff(wire[:, 0::2].astype(int), axis=0) + 128) % 256 - 128)
    assert len(wire) == 12_000
    assert 1 <= step.max() <= 2  # 4 periods of 1e-3 turns are 1.02 of 256


def test_refused_points_and_switched_frames_are_counted_the_first_time_only_though_all_are_made_anew():
    position = np.array([[0, 0, 0.2], [9, 9, 9], [np.nan] * 3, [0, 0, 0.2], [0, 0, 0.2]], np.float32)
    source = PointSource(FocalPoints(position, np.float32([0.7, 1, 1, 0.7, 0.7])), update_rate=100.0)
    frames = MadeFrames(source, Driver(array_model("sonicsurface")), repeats=3)
    for _ in range(2):  # also when the frames are gone through again
        assert len(list(frames)) == 3
        assert (frames.making.refused, frames.making.switched) == (2, 3)
    together = MadeFrames(source, Driver([array_model("sonicsurface"), array_model("sonicsurface")]))
    assert len(list(together)) == 1
    assert together.making.switched == 6  # of two arrays


def test_arrays_are_let_go_of_when_playing_ends_and_when_another_cannot_be_opened():
    connection = Connection(backend=emulated_backend("emulator", clock=VirtualClock()))
    arrays = load_rig("emulator")
    kept = []  # so that no link is closed because nothing refers to it any more
    with connection.all_of(arrays) as links:
        kept += links
    with pytest.raises(DeviceBusyError) as refused, connection.all_of([*arrays, *arrays]):
        pytest.fail("the same array was opened twice")
    kept.append(refused.value)
    with connection.all_of(arrays) as links:
        assert links[0].status().level == 0


def test_a_point_list_is_played_at_its_own_rate(tmp_path):
    rng = np.random.default_rng(1)
    position = np.column_stack([rng.uniform(-0.05, 0.05, (700, 2)), rng.uniform(0.15, 0.25, 700)]).astype(np.float32)
    intensity = rng.uniform(0, 1, 700).astype(np.float32)
    path = tmp_path / "points.PTLIST"
    write_ptlist(path, position, intensity, 5000.0)
    bus = emulated_backend("emulator", clock=VirtualClock(), record=2000)
    playback = play_file(path, connection=Connection(backend=bus))
    drives = Driver(array_model("emulator")).drive(FocalPoints(position, intensity))
    expected = encode_frames(drives.delay, drives.amplitude, array="emulator")
    np.testing.assert_array_equal(bus.board().played[: playback.played.frames], expected)
    assert playback.played.update_rate == 5000.0
    assert "jumps" not in playback.as_dict()
    with pytest.raises(StrategyError, match="holds focal points"):
        play_file(path, sampling=SamplingStrategy(), connection=VIRTUAL)


def test_times_that_do_not_increase_far_into_the_file_end_with_the_array_off(moving, monkeypatch):
    real = ContourFile.motion

    def broken(self, first=0, stop=None):
        arrays = real(self, first, stop)
        if "time" in arrays and first > 0 and len(arrays["time"]) > 2:
            arrays["time"][1] = arrays["time"][0]
        return arrays

    monkeypatch.setattr(ContourFile, "motion", broken)
    monkeypatch.setattr(source_module, "POINTS_A_READ", 2000)
    bus = emulated_backend("emulator", clock=VirtualClock())
    with pytest.raises(PoseError, match="does not increase"):
        play_file(moving, connection=Connection(backend=bus))
    assert not bus.board().playing[1::2].any()


def pair(tmp_path):
    turned = [0.3, 0.0, 0.1, 0.0, -0.3826834, 0.0, 0.9238795]
    path = tmp_path / "rig.json"
    path.write_text(json.dumps([{"array": "emulator"}, {"array": "emulator", "pose": turned}]))
    return load_rig(str(path))


def test_several_arrays_focus_at_the_same_point_each_from_where_it_stands(tmp_path, moving):
    arrays = pair(tmp_path)
    driver = Driver([placed.model for placed in arrays])
    focus = FocalPoints(np.array([[0.03, -0.02, 0.2]], np.float32), np.ones(1, np.float32))
    for placed, part in zip(arrays, driver.split(driver.drive(focus)), strict=True):
        distance = np.linalg.norm(placed.model.position.astype(float) - focus.position[0], axis=1)
        phase = 2 * np.pi * (part.delay[0] + distance * 40e3 / 343.0)
        assert abs(np.exp(1j * phase).mean()) > 0.9999
    assert abs(arrays[1].model.position.mean(axis=0) - [0.3, 0, 0.1]).max() < 1e-6
    playback = play_file(moving, array=arrays, sampling=SamplingStrategy(update_rate=1000.0), connection=VIRTUAL)
    assert [report.frames for report in playback.reports] == [playback.played.frames] * 2
    assert all(report.off_confirmed for report in playback.reports)
    assert len(playback.as_dict()["arrays"]) == 2


def test_when_one_of_several_arrays_is_lost_the_others_are_switched_off(tmp_path, moving, monkeypatch):
    buses = [emulated_backend("emulator", clock=VirtualClock()) for _ in range(2)]
    inject(buses[1], Fault(FaultKind.UNPLUG, byte=200_000))
    waiting = list(buses)
    monkeypatch.setattr(
        "palpate.render.playback.file_playback.emulated_backend", lambda name, **options: waiting.pop(0)
    )
    with pytest.raises(DeviceLostError) as caught:
        play_file(moving, array=pair(tmp_path), connection=VIRTUAL)
    assert caught.value.report.stopped_by == "device"
    assert not buses[0].board().playing[1::2].any()


def test_a_rig_that_is_none_is_refused_by_field(tmp_path):
    for text, message in (
        ("[]", "list of at least one"),
        ("{", "not JSON"),
        ('[{"serial": "a"}]', "array must be a str"),
        ('[{"array": "emulator", "place": 1}]', "unknown field 'place'"),
        ('[{"array": "emulator", "pose": [0, 0]}]', "shape"),
        ('[{"array": "emulator", "pose": [0, 0, 0, 0, 0, 0, 2]}]', "norm"),
        ('[{"array": "emulator", "baud": "fast"}]', "baud must be a int"),
        (json.dumps([{"array": "emulator"}] * 5000), "lists 5,000 arrays, more than the 127 devices of a USB bus"),
    ):
        (tmp_path / "rig.json").write_text(text)
        with pytest.raises(StrategyError, match=message):
            load_rig(str(tmp_path / "rig.json"))


def test_rates_that_one_of_the_arrays_lacks_are_refused_before_anything_is_sent(moving):
    arrays = (PlacedArray(array_model("emulator")), PlacedArray(array_model("sonicsurface")))
    with pytest.raises(UpdateRateError, match=r"89\.3"):
        play_file(moving, array=arrays, connection=Connection(clock="virtual", emulate=True))
    sampling = SamplingStrategy(update_rate=20_000.0)
    with pytest.raises(UpdateRateError, match="28 frames"):
        play_file(moving, array="pat16", sampling=sampling, connection=Connection(clock="virtual", emulate=True))


def points_file(tmp_path, *, count=700, rate=5000.0, intensity=1.0):
    path = tmp_path / "points.ptlist"
    write_ptlist(path, np.tile([0.01, 0.0, 0.2], (count, 1)), np.full(count, intensity), rate)
    return path


def test_a_point_list_can_be_cut_short_and_not_to_nothing(tmp_path):
    path = points_file(tmp_path)
    assert play_file(path, duration=0.0101, connection=VIRTUAL).played.frames == 51
    for duration in (-0.1, 0.0, np.nan, np.inf):
        with pytest.raises(StrategyError, match="duration must be positive"):
            play_file(path, duration=duration, connection=VIRTUAL)


@pytest.mark.parametrize("frequency", [200.0, 300.0])
def test_am_of_a_focal_point_at_rest_reaches_a_sonicsurface_at_its_frequency(frequency, static):
    # The makers' TestBeamStearingWithAudibleMod.py modulates at 300 Hz by swaps of focus and off, a byte each.
    ports = emulated_backend("sonicsurface", clock=VirtualClock(), record=10_000)
    am = SamplingStrategy(pace=Pace(kind="still"), am=AmplitudeModulation(frequency=frequency, wave="square"))
    asked = SamplingStrategy.from_json(json.dumps({"pace": {"kind": "still"}, "am": am.described()["am"]}))
    rate = usual_rate(array_model("sonicsurface"), asked)
    assert rate == 23_040  # bytes a second at 230400 Bd
    playback = play_file(
        static,
        array="sonicsurface",
        sampling=replace(asked, update_rate=rate),
        duration=0.2,
        connection=Connection(backend=ports),
    )
    board = ports.board()
    on = np.flatnonzero((board.played < 32).any(axis=1))
    assert len(np.unique(board.played[on], axis=0)) == 1
    assert len(on) == pytest.approx(0.2 * frequency, abs=1)
    rises = board.played_ns[on]
    assert np.abs(np.diff(rises) * 1e-9 - 1 / frequency).max() <= 1.5 / 23_040
    falls = board.played_ns[on + 1]
    assert np.abs((falls - rises) * 1e-9 - 0.5 / frequency).max() <= 1.5 / 23_040
    assert not board.emitting
    assert (playback.switched, playback.underruns) == (0, 0)


def test_am_that_whole_frames_reach_and_other_contents_keep_the_rate_of_whole_frames(moving):
    model = array_model("sonicsurface")
    slow = SamplingStrategy(pace=Pace(kind="still"), am=AmplitudeModulation(frequency=22.0))
    circling = SamplingStrategy(pace=Pace(kind="still"), am=AmplitudeModulation(), lm=LateralModulation())
    for strategy in (preset("stm"), preset("lm"), preset("dtp"), slow, circling):
        assert usual_rate(model, strategy) == pytest.approx(230_400 / 10 / 258)
    assert usual_rate(array_model("sonicsurface", baud=1_462_857), preset("am-multi-focus")) == 1_462_857 / 2580
    swift = SamplingStrategy(pace=Pace(kind="still"), am=AmplitudeModulation(frequency=300.0))
    assert usual_rate(array_model("sonicsurface", baud=1_462_857), swift) == 1_462_857 / 10 / 4  # below 40 kHz
    assert usual_rate(array_model("pat16"), preset("am")) == 10_000


def test_am_of_a_motion_is_refused_on_a_sonicsurface_before_anything_is_sent(moving):
    """By docs/guide/boards.md: it holds one pattern and off, and plays motions at 89.3 Hz, so with am of 44 Hz."""
    ports = emulated_backend("sonicsurface", clock=VirtualClock(), record=100)
    with pytest.raises(StrategyError, match=r"am on a sonicsurface needs a single pose that does not move.*44\.7 Hz"):
        play_file(moving, array="sonicsurface", sampling="am", connection=Connection(backend=ports))
    assert len(ports.board().played) == 0
    slow = SamplingStrategy(pace=Pace(kind="still"), am=AmplitudeModulation(frequency=22.0))
    slow = replace(slow, update_rate=usual_rate(array_model("sonicsurface"), slow))
    sent = play_file(moving, array="sonicsurface", sampling=slow, duration=0.2, emulate=True, clock="virtual")
    assert sent.frames == 18


@pytest.mark.parametrize(("depth", "level", "counted"), [(1.0, 1.0, False), (0.5, 1.0, True), (1.0, 0.7, True)])
def test_am_that_a_board_can_only_switch_is_counted_unless_it_goes_from_0_to_full(depth, level, counted, static):
    """Full am becomes a square wave of its frequency; less depth, or less than full level, is lost."""
    strategy = SamplingStrategy(pace=Pace(kind="still"), am=AmplitudeModulation(depth=depth), update_rate=23_040)
    drive, connection = DriveStrategy(level_max=level), Connection(clock="virtual", emulate=True)
    done = play_file(static, array="sonicsurface", sampling=strategy, drive=drive, duration=0.05, connection=connection)
    assert (done.switched > 1000) == counted
    assert (done.switched == 0) != counted


@pytest.mark.parametrize(("array", "emulate"), [("autd3", True), ("pat16", False)])
def test_a_virtual_clock_is_refused_for_an_array_that_has_none(array, emulate, static):
    """The vendor's emulated autd3 keeps real time (device/boards/autd3/vendor_client.py), as every real board does."""
    with pytest.raises(StrategyError, match=f"clock=virtual is not for {array}, .*real"):
        play_file(static, array=array, duration=0.1, clock="virtual", emulate=emulate)


def test_poses_far_apart_are_held_until_the_next_one(static, tube, tmp_path):
    with ContourFile(static) as file:
        pose = file.motion()["pose"]
    path = tmp_path / "slow.h5"
    record(path, tube, Palm(), HandMotion(np.arange(4) * 0.3, np.repeat(pose, 4, axis=0)), closed_contour())
    focus, sampler = focus_of(path, SamplingStrategy(hold=0.1, update_rate=1000.0))
    assert sampler.count.held == 0
    assert (focus.intensity == 1).all()
    assert len(focus.intensity) == 1200  # the last pose lasts as long as those before it
