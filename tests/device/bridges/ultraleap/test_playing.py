"""What palpate-ultraleap hands over, beside what it was sent: docs/formats/ultraleap-bridge.md, "Time"."""

import os
import subprocess
import time

import numpy as np
import pytest
from ultraleap_bridge import (
    RATE,
    Bridge,
    Client,
    compare,
    focus_file,
    held_numbers,
    numbers_of,
    recorded,
    shared_program,
    unlike_samples,
)

CASES = [  # points, rate of palpate [Hz], rate of the library [Hz]
    (1, 40_000, 40_000),
    (1, 10_000, 16_000),
    (1, 10_000, 40_000),
    (2, 20_000, 20_000),
    (3, 10_000, 13_333.333),
    (4, 10_000, 10_000),
    (4, 8_000, 10_000),
    (1, 39_999, 40_000),
]


@pytest.fixture(scope="session", params=[3, pytest.param(2, marks=pytest.mark.exhaustive)], ids=["sdk3", "sdk2"])
def program(request, tmp_path_factory):
    return shared_program(tmp_path_factory, request.param)


def rates_of(points, device_rate):
    return ",".join([str(device_rate)] * points)


def play(program, folder, samples, rate, *options, **stub):
    """The program plays a file: its process, and what the fake array recorded."""
    (folder / "points.bin").write_bytes(focus_file(samples, rate))
    environment = os.environ | {f"STUB_{name.upper()}": str(value) for name, value in stub.items()}
    words = [program, "play", folder / "points.bin", *options]
    return subprocess.run(
        words, env=environment | {"STUB_RECORD": str(folder / "record")}, capture_output=True, text=True, check=False
    )


@pytest.mark.exhaustive(after=2)
@pytest.mark.parametrize(("points", "rate", "device_rate"), CASES)
def test_each_device_sample_gets_the_sample_whose_time_it_is(program, tmp_path, points, rate, device_rate):
    sent = unlike_samples(rate // 10, points)
    record = tmp_path / "record"
    with Bridge(program, record=record, rates=rates_of(points, device_rate)) as bridge, Client(bridge.port) as client:
        device_rate = client.open(points, float(rate))  # as the library gives it: float32, or whole hertz
        client.wait(lambda state: state.device_samples > 0)
        state = client.play_out(sent)
        assert (state.taken, state.begun, state.passed, state.dropped) == (len(sent), len(sent), 0, 0)
    _, heard = recorded(record, points)
    assert compare(heard, sent) == (len(sent), len(sent), 0, 0, 0, True, True)
    numbers = numbers_of(heard, sent)
    begin = int(np.argmax(numbers == 0))
    dry = int(np.argmax(numbers == len(sent) - 1))
    least, most = (held_numbers(rate, device_rate, dry - begin, tie=side) for side in (-1, 1))
    assert (least <= numbers[begin:dry]).all()
    assert (numbers[begin:dry] <= most).all()
    held = int((numbers == len(sent) - 1).sum())
    assert abs(held - round(device_rate * (1 / rate + 0.1))) <= 1  # 0.1 s after its own time


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    "stub",
    [
        {"tick_ns": 1000, "lengths": "40,1,79,13"},  # times in whole microseconds, intervals of any length
        {"tick_ns": 9999},
        {"lengths": "40,39,41"},
        {"lengths": "400"},
        {"lengths": "1"},
    ],
    ids=str,
)
def test_neither_rounded_times_nor_lengths_of_intervals_leave_a_sample_out(program, tmp_path, stub):
    sent = unlike_samples(3000)
    done = play(program, tmp_path, sent, RATE, **stub)
    assert done.returncode == 0, done.stderr
    _, heard = recorded(tmp_path / "record")
    numbers = numbers_of(heard, sent)
    assert list(numbers[numbers != -1]) == list(range(3000))  # each once, in order
    assert numbers[-1] == -1
    assert " 3000 samples taken, 3000 begun, 0 passed, 0 dropped; dry 0 times" in done.stdout


def test_a_file_is_played_again_without_a_pause(program, tmp_path):
    sent = unlike_samples(500, 2)
    done = play(program, tmp_path, sent, 20_000.0, "--repeat", "3")
    assert done.returncode == 0, done.stderr
    _, heard = recorded(tmp_path / "record", 2)
    numbers = numbers_of(heard, sent)
    assert list(numbers[numbers != -1]) == [*range(500)] * 3
    assert "500 samples of 2 focal points at 20000 Hz 3 times on the array USX" in done.stdout


def test_a_file_longer_than_the_queue_is_played_whole(program, tmp_path):
    sent = unlike_samples(70_000)
    done = play(program, tmp_path, sent, 200_000.0, rates="200000", lengths="2000")
    assert done.returncode == 0, done.stderr
    _, heard = recorded(tmp_path / "record")
    assert compare(heard[heard[:, 0, 3] > 0], sent)[:5] == (70_000, 70_000, 0, 0, 0)
    assert len(heard[heard[:, 0, 3] > 0]) == 70_000


def test_a_silent_point_stays_where_it_was(program, tmp_path):
    sent = unlike_samples(60, 2)
    sent[20:40, 1, 3] = 0
    sent[40:50, :, 3] = 0
    sent[40:50, :, :3] = 0
    play(program, tmp_path, sent, 20_000.0)
    _, heard = recorded(tmp_path / "record", 2)
    first = int(np.argmax(heard[:, 0, 3] > 0))
    heard = heard[first : first + 60]
    assert (heard[:20] == sent[:20]).all()
    assert (heard[20:40, 0] == sent[20:40, 0]).all()
    assert (heard[20:40, 1, :3] == sent[19, 1, :3]).all()
    assert (heard[20:40, 1, 3] == 0).all()
    assert (heard[40:50, :, 3] == 0).all()
    assert (heard[40:50, 0, :3] == sent[39, 0, :3]).all()
    assert (heard[50:] == sent[50:]).all()


def test_callbacks_that_are_missed_skip_by_time_and_the_rest_keeps_its_time(program, tmp_path):
    sent = unlike_samples(6000)
    done = play(program, tmp_path, sent, RATE, stalls="0.02:0.01,0.05:0.03")
    assert done.returncode == 0, done.stderr
    times, heard = recorded(tmp_path / "record")
    numbers = numbers_of(heard, sent)
    sounding = numbers >= 0
    begin = times[np.argmax(sounding)]
    assert (numbers[sounding] == np.rint((times[sounding] - begin) * RATE)).all()
    assert compare(heard, sent)[1:5] == (6000 - 1600, 0, 0, 1600)
    assert " 6000 samples taken, 4400 begun, 1600 passed, 0 dropped; dry 0 times" in done.stdout
    assert "missed callbacks: 2 by the times of samples" in done.stdout


def test_a_stall_beyond_what_waits_is_silent_at_once_and_what_follows_begins_anew(program, tmp_path):
    first, second = unlike_samples(4000)[:2000], unlike_samples(4000)[2000:]
    record = tmp_path / "record"
    with Bridge(program, record=record, stalls="0.05:0.3") as bridge, Client(bridge.port) as client:
        client.open()
        client.wait(lambda state: state.device_samples > 0)
        client.foci(first[:400])
        client.wait(lambda state: state.begun == 400)
        client.foci(first[400:])
        state = client.wait(lambda state: state.missed_callbacks == 1 and state.waiting == 0)
        assert state.begun + state.passed == 2000
        assert state.passed > 0
        assert state.dry_times in (1, 2)
        client.play_out(second)
    _, heard = recorded(record)
    numbers = numbers_of(heard, np.concatenate([first, second]))
    later = numbers[numbers >= 2000]
    assert list(np.unique(later)) == [*range(2000, 4000)]
    assert numbers[np.argmax(numbers == 2000) - 1] == -1


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("seed", range(12))
def test_whatever_a_client_does_counts_and_record_agree(program, tmp_path, seed):
    """Blocks of any size, pauses, STOP and OPEN at any time, while callbacks are missed at any time."""
    random = np.random.default_rng(seed)
    sent = unlike_samples(40_000)
    stalls = ",".join(f"{at:.3f}:{random.uniform(0.001, 0.05):.3f}" for at in np.sort(random.uniform(0.01, 0.6, 6)))
    record, start, first, states = tmp_path / "record", 1, 0, {}
    with Bridge(program, record=record, stalls=stalls, lengths="40,7,93,1") as bridge, Client(bridge.port) as client:
        client.open()
        for choice in random.choice(["foci", "stop", "open", "wait"], 40, p=[0.6, 0.1, 0.05, 0.25]):
            if choice == "foci":
                count = int(random.integers(0, 1000))
                client.foci(sent[first : first + count])
                first += count
            elif choice == "wait":
                time.sleep(random.uniform(0, 0.05))
            elif choice == "stop":
                assert client.state(b"STOP").intensity == 0
            else:
                states[start] = client.state(b"STOP")
                client.open()
                start += 1
        states[start] = client.wait(lambda state: state.waiting == 0 and state.intensity == 0)
    assert sum(state.taken for state in states.values()) == first
    for start, state in states.items():
        _, heard = recorded(record, start=start)
        result = compare(heard, sent)
        assert (result.recorded, result.wrong, result.twice) == (state.begun, 0, 0)
        assert state.taken == state.begun + state.passed + state.dropped
        assert heard[-1, 0, 3] == 0
