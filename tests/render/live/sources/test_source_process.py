"""A source in a process of its own: it starts, sends, ends with its holder, and says what ended it.

Processes take longer than quick tests may: of each kind of end one example is quick, by `run_source` in this process.
"""

import os
import select
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from live_senders import DOWN, ListedSource, datagram_of, joint_frames, palm_frames

from palpate.datasets import Y_UP
from palpate.datasets.errors import RecordingError
from palpate.render import exploration
from palpate.render.errors import StrategyError
from palpate.render.live.sources.hand_frame import SeenHand
from palpate.render.live.sources.messages import PoseSender, message_pair, received_messages
from palpate.render.live.sources.named_sources import live_hand, patch_layout
from palpate.render.live.sources.replay import ReplaySource
from palpate.render.live.sources.source_process import SourceSettings, run_source, start_source
from palpate.render.live.sources.udp import UdpSource


def run_here(settings):
    """Exit code and messages of a source that runs in this process."""
    receiver, descriptor = message_pair()
    sender = PoseSender(descriptor)
    try:
        code = run_source(settings, sender)
        return code, received_messages(receiver)
    finally:
        sender.close()
        os.close(receiver)


def messages_until(process, enough, seconds=20.0):
    """Messages of a process until there are enough, or it has ended."""
    found, end = [], time.monotonic() + seconds
    while not enough(found) and time.monotonic() < end:
        select.select([process.socket_fd], [], [], 0.2)
        try:
            found += received_messages(process.socket_fd)
        except EOFError:
            break
    return found


def test_a_source_that_ends_says_that_there_is_no_hand_and_then_why():
    source = ListedSource(palm_frames(90.0, 0.1))
    code, messages = run_here(SourceSettings(source))
    *poses, lost, end = messages
    assert code == 0
    assert len(poses) == 9 - sum(message.skipped for message in messages)  # all at once: some are too many
    assert all(message.pose is not None for message in poses)
    assert lost.is_lost
    assert end.fault == "the source has ended"
    assert not source.is_open


def test_a_source_that_fails_says_so_after_the_hand_is_off():
    code, messages = run_here(SourceSettings(ListedSource(palm_frames(90.0, 1 / 90), error="cable pulled")))
    assert code == 1
    assert [message.is_lost for message in messages] == [False, True, False]
    assert messages[-1].fault == "the source failed: cable pulled"


def test_joints_are_aligned_and_patches_posed():
    settings = SourceSettings(
        ListedSource(joint_frames(90.0, 1 / 90)), alignment=Y_UP, patches=patch_layout(live_hand("planes"))
    )
    _, (message, *_) = run_here(settings)
    assert message.patch_pose.shape == (15, 7)
    assert message.pose[2] == pytest.approx(0.2, abs=0.03)


def test_settings_are_checked_where_they_are_made():
    with pytest.raises(StrategyError, match="side must be one of any, left, right, not 'both'"):
        SourceSettings(UdpSource(), side="both")
    with pytest.raises(RecordingError, match="must have shape"):
        SourceSettings(UdpSource(), alignment=[1, 2])
    assert SourceSettings(UdpSource(), side="Left").side == "left"


def test_a_source_that_another_process_cannot_make_is_refused_before_it_is_started(monkeypatch):
    with pytest.raises(StrategyError, match="list lacks one of them"):
        start_source(SourceSettings([]))
    with pytest.raises(StrategyError, match="cannot be given to another process: cannot pickle"):
        start_source(SourceSettings(ListedSource([], error=(k for k in ()))))
    monkeypatch.setattr(ListedSource, "__module__", "__main__")
    with pytest.raises(StrategyError, match="put it into a module of its own"):
        start_source(SourceSettings(ListedSource([])))


@pytest.mark.exhaustive
def test_an_exploration_comes_in_real_time_and_then_the_end():
    motion = exploration("cube", duration=0.5)
    with start_source(SourceSettings(ReplaySource.of_motion(motion))) as process:
        assert process.is_alive
        messages = messages_until(process, lambda found: found and found[-1].fault)
    assert messages[-1].fault == "the source has ended"
    poses = messages[:-2]
    assert len(poses) == 45
    assert np.array_equal([message.pose for message in poses], motion.pose)  # bit for bit
    stamps = np.array([message.stamp_ns for message in poses]) * 1e-9
    assert np.allclose(stamps - stamps[0], motion.time, atol=1e-6)


@pytest.mark.exhaustive
def test_udp_comes_through_with_its_faults():
    settings = SourceSettings(UdpSource(port=free_port()))
    with start_source(settings) as process, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        address = ("127.0.0.1", settings.source.port)
        found = []
        for frame in palm_frames(90.0, 30.0):
            sender.sendto(datagram_of(frame), address)
            time.sleep(1 / 90)
            found += received_messages(process.socket_fd)
            if len(found) > 20:
                break
        sender.sendto(b"garbage", address)
        sender.sendto(datagram_of(SeenHand(frame.time + 0.01)), address)
        found += messages_until(process, lambda found: found and found[-1].is_lost)
    assert sum(message.pose is not None for message in found) > 20
    (fault,) = [message.fault for message in found if message.fault]
    assert fault.startswith("a datagram is no JSON")
    assert found[-1].is_lost


@pytest.mark.exhaustive
def test_a_class_of_the_users_own_module_is_found():
    with start_source(SourceSettings(ListedSource(palm_frames(90.0, 3 / 90), pause=0.01))) as process:
        messages = messages_until(process, lambda found: found and found[-1].fault)
    assert sum(message.pose is not None for message in messages) == 3


@pytest.mark.exhaustive
def test_a_source_that_waits_for_ever_ends_when_it_is_closed():
    process = start_source(SourceSettings(ListedSource(palm_frames(90.0, 1 / 90), pause=1000.0)))
    assert process.is_alive
    began = time.monotonic()
    process.close()
    assert time.monotonic() - began < 1.9  # without being killed
    assert not process.is_alive
    process.close()


@pytest.mark.exhaustive
def test_a_source_ends_with_a_holder_that_is_killed(tmp_path):
    program = tmp_path / "holder.py"
    program.write_text(
        "import time\n"
        "from live_senders import ListedSource, palm_frames\n"
        "from palpate.render.live.sources.source_process import SourceSettings, start_source\n"
        "process = start_source(SourceSettings(ListedSource(palm_frames(90.0, 1.0), pause=1000.0)))\n"
        "print(process.process_id, flush=True)\n"
        "time.sleep(60)\n"
    )
    holder = subprocess.Popen([sys.executable, str(program)], stdout=subprocess.PIPE, text=True)
    source = int(holder.stdout.readline())
    assert is_running(source)
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    holder.stdout.close()
    end = time.monotonic() + 10.0
    while is_running(source) and time.monotonic() < end:
        time.sleep(0.02)
    assert not is_running(source)


@pytest.mark.exhaustive
def test_a_source_that_is_killed_ends_its_messages():
    source = ReplaySource(np.arange(1000) / 90, np.tile([0.0, 0.0, 0.2, *DOWN], (1000, 1)), duration=12.0)
    with start_source(SourceSettings(source)) as process:
        assert messages_until(process, lambda found: found)
        os.kill(process.process_id, signal.SIGKILL)
        messages_until(process, lambda found: False, seconds=5.0)
        with pytest.raises(EOFError, match="has ended"):
            received_messages(process.socket_fd)
    assert not process.is_alive


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def is_running(process_id):
    try:
        with open(f"/proc/{process_id}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
