"""The link to a bridge: against its model by a virtual clock, and against servers that do what a bridge should not."""

from __future__ import annotations

import contextlib
import re
import socket
import struct
import threading
import time
from array import array
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from bridge_cases import TIMEOUT, Peer, PlayingBridge, ScriptedBridge, greeting, message, samples, status

from palpate.device import (
    DeviceBusyError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceTimeoutError,
    FrameError,
    Limits,
    Link,
    LinkError,
    Player,
    SafetyLimitError,
    UpdateRateError,
    VirtualClock,
    array_model,
    open_link,
)
from palpate.device.boards.stratos import link as link_module
from palpate.device.boards.stratos.channel import parsed_address
from palpate.device.boards.stratos.model import EmulatedBridge

MODEL = array_model("stratos")
FREE = Limits(on_time_max=None, duty_max=None)


def emulated(serials: tuple[str, ...] = ("USX:1",)) -> EmulatedBridge:
    return EmulatedBridge(serials, clock=VirtualClock(), record=1 << 20)


def played(bridge: EmulatedBridge, index: int = 0) -> list[tuple[bytes, int]]:
    """What an array was handed until now, and when."""
    assert bridge.board(index=index).frames_played >= 0  # plays what is due
    return list(bridge.board(index=index).played)


def block(foci: np.ndarray) -> array[int]:
    return array("B", foci.tobytes())


def blocks(foci: np.ndarray, size: int) -> Iterator[array[int]]:
    return (block(foci[first : first + size]) for first in range(0, len(foci), size))


@pytest.mark.parametrize("points", [1, 4])
@pytest.mark.parametrize("size", [37, 1500])
def test_what_is_played_is_what_was_given_a_period_apart_and_then_silence(points: int, size: int) -> None:
    bridge, foci = emulated(), samples(3000, points)
    rate = 40e3 / (4 if points == 4 else 3)
    with open_link(MODEL.with_points(points), backend=bridge) as link:
        report = Player(link, limits=FREE).play(blocks(foci, size), update_rate=rate)
        assert bridge.board().intensity == 0
    *content, (last, _) = played(bridge)
    assert b"".join(sample for sample, _ in content) == foci.tobytes()
    assert last == bytes(16 * points)
    assert set(np.diff([began_ns for _, began_ns in content])) == {round(1e9 / rate)}
    assert (report.frames, report.frames_exact, report.frames_cleared, report.bytes) == (3000, True, 0, foci.nbytes)
    assert (report.board_underruns, report.board_starved, report.underruns) == (0, 0, 0)
    assert (report.stopped_by, report.serial, report.transport) == ("end", "USX:1", "emulated")
    assert report.duration == pytest.approx(3000 / rate)


def test_a_report_says_that_silence_was_handed_over_and_that_no_one_confirms_it() -> None:
    with open_link(MODEL, backend=emulated()) as link:
        report = Player(link).play([block(samples(40))], update_rate=40e3)
    assert (report.off_sent, report.off_confirmed, report.may_emit) == (True, None, None)
    doubt = "array stratos was handed silence through its driver, which does not say whether the array is silent"
    assert report.off_doubt == report.as_dict()["off_doubt"] == doubt
    assert repr(report).endswith("40 frames at 40000 Hz, 0 underruns, off unknown)")


def test_a_stop_drops_what_waits_and_counts_what_was_played() -> None:
    bridge = emulated()
    foci = samples(20_000)
    with open_link(MODEL, backend=bridge) as link:
        player = Player(link, limits=FREE)

        def until_stopped() -> Iterator[array[int]]:
            for number, own in enumerate(blocks(foci, 1000)):
                if number == 15:
                    player.stop()
                yield own

        report = player.play(until_stopped(), update_rate=40e3)
        assert bridge.board().intensity == 0
    assert report.stopped_by == "stop"
    assert report.frames_cleared is not None
    assert 0 <= report.frames_cleared <= 4096
    content = [sample for sample, _ in played(bridge)]
    assert len(content) == report.frames - report.frames_cleared
    assert b"".join(content) == foci[: len(content)].tobytes()


def test_a_bridge_that_ends_amid_a_playback_is_told_with_what_to_do() -> None:
    bridge = emulated()

    def unplugging() -> Iterator[array[int]]:
        for number, own in enumerate(blocks(samples(20_000), 500)):
            if number == 20:
                bridge.unplug()
            yield own

    with open_link(MODEL, backend=bridge) as link:
        player = Player(link, limits=FREE)
        with pytest.raises(DeviceLostError, match="is gone; array stratos may still be emitting, switch it off"):
            player.play(unplugging(), update_rate=40e3)
        assert player.report is not None
        assert (player.report.stopped_by, player.report.off_sent) == ("device", False)
        with pytest.raises(DeviceLostError):
            link.status()
        link.close()
        link.close()  # nothing happens
    with pytest.raises(DeviceNotFoundError, match="array USX:1 is unplugged"):
        open_link(MODEL, backend=bridge)
    bridge.replug()
    with open_link(MODEL, backend=bridge) as link:
        assert Player(link).play([block(samples(4))], update_rate=40e3).frames == 4


def test_a_pause_between_blocks_is_an_underrun_where_the_last_focal_point_sounds() -> None:
    bridge = emulated()

    def pausing() -> Iterator[array[int]]:
        yield block(samples(4000))
        while link.bytes_sent < 4000 * 16:  # by another thread
            time.sleep(1e-3)
        bridge.clock.advance(0.1 + 0.05)  # these samples, and a pause
        yield block(samples(4000, seed=1))

    with open_link(MODEL, backend=bridge) as link:
        report = Player(link, limits=FREE).play(pausing(), update_rate=40e3)
    assert (report.frames, report.board_underruns) == (8000, 1)
    assert report.board_starved == pytest.approx(0.05)
    content = [sample for sample, _ in played(bridge)][:-1]
    assert b"".join(content) == samples(4000).tobytes() + samples(4000, seed=1).tobytes()


def test_a_bridge_whose_samples_wait_hears_from_a_player_that_has_nothing_to_send() -> None:
    """At 1 kHz its queue holds 4 s, and it takes a client that says nothing for 0.5 s for dead."""
    for asks in (True, False):
        bridge = emulated()
        with open_link(MODEL, backend=bridge) as link:
            link.start(40)
            link.write(block(samples(2000)))
            for _ in range(5):
                bridge.clock.advance(0.3)
                if asks:
                    assert link.bytes_under_way == 0  # a player looks at it while it waits for its next block
            assert bridge.board().frames_played == (1501 if asks else 501)
            if not asks:
                with pytest.raises(LinkError, match=r"says: nothing was heard for 0\.5 s"):
                    link.status()


def test_counts_run_on_over_playbacks_and_start_silences_what_plays() -> None:
    bridge = emulated()
    with open_link(MODEL, backend=bridge) as link:
        link.start(1)
        link.write(block(samples(100)))
        bridge.clock.advance(50.5 / 40e3)
        status = link.status()
        assert status is not None
        assert (status.frames_played, status.fifo_frames, status.level, status.divider) == (51, 49, None, 1)
        link.start(2)
        link.start(4)
        assert bridge.board().intensity == 0
        status = link.status()
        assert status is not None
        assert (status.frames_played, status.fifo_frames, status.divider) == (51, 0, 4)
        link.write(block(samples(3)))
        bridge.clock.advance(0.01)
        status = link.status()
        assert status is not None
        assert (status.frames_played, status.underruns, link.bytes_sent) == (54, 1, 103 * 16)
    assert bridge.board().intensity == 0


def test_a_write_waits_for_room_and_can_be_abandoned() -> None:
    bridge = emulated()
    foci = samples(10_000)
    with open_link(MODEL, backend=bridge) as link:
        link.start(1)
        asked: list[int] = []

        def abandon() -> bool:
            asked.append(bridge.clock.now_ns())
            return len(asked) > 3

        link.write(block(foci), abandon=abandon)
        assert len(asked) == 4
        assert max(np.diff(asked)) <= 50e6  # the bound that `Link` promises
        sent = link.bytes_sent
        assert 4096 * 16 <= sent < foci.nbytes
        assert link.clear()
        bridge.clock.advance(1.0)
        assert b"".join(sample for sample, _ in played(bridge)) == foci[: len(played(bridge))].tobytes()
        with pytest.raises(FrameError, match="17 bytes are no multiple of 16, the size of a frame"):
            link.write(array("B", bytes(17)))


def test_an_array_that_another_has_is_busy_until_it_is_let_go_of() -> None:
    bridge = emulated(("USX:1", "USX:2"))
    with open_link(MODEL, backend=bridge) as first:
        with pytest.raises(DeviceBusyError, match="array USX:1 is in use: stop the other player"):
            open_link(MODEL, backend=bridge)
        with open_link(MODEL, serial="USX:2", backend=bridge) as second:
            assert (first.serial, second.serial) == ("USX:1", "USX:2")
    with open_link(MODEL, backend=bridge):
        pass
    with pytest.raises(DeviceNotFoundError, match="no emulated bridge has the array 'USX:3'; known: USX:1, USX:2"):
        open_link(MODEL, serial="USX:3", backend=bridge)


def test_a_rate_that_the_library_does_not_give_for_so_many_points_is_refused_and_nothing_may_emit() -> None:
    with open_link(MODEL.with_points(4), backend=emulated()) as link:
        player = Player(link)
        reason = r"says: a rate of 40000 Hz is outside 1 to 10000 Hz, at which the library takes 4 focal points$"
        with pytest.raises(LinkError, match=reason):
            player.play([block(samples(4, 4))], update_rate=40e3)
    with open_link(MODEL, backend=emulated()) as link, pytest.raises(UpdateRateError, match="39000 Hz is not 40000 Hz"):
        Player(link).play([block(samples(4))], update_rate=39e3)


@pytest.mark.parametrize(
    ("address", "wanted"),
    [
        (None, ("127.0.0.1", 24040)),
        ("", ("127.0.0.1", 24040)),
        ("lab-pc", ("lab-pc", 24040)),
        ("lab-pc:1", ("lab-pc", 1)),
        (":65535", ("127.0.0.1", 65535)),
        ("[::1]:9000", ("::1", 9000)),
        ("[::1]", ("::1", 24040)),
        ("fe80::1", ("fe80::1", 24040)),
    ],
)
def test_addresses_are_read_as_people_write_them(address: str | None, wanted: tuple[str, int]) -> None:
    assert parsed_address(address) == wanted


@pytest.mark.parametrize("address", ["pc:", "pc:0", "pc:65536", "pc:-1", "pc:1e3", "pc:٣", "pc:99999999999"])
def test_a_port_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(LinkError, match=r"with a port of 1\.\.65535, not"):
        open_link(MODEL, serial=address)


def test_nothing_that_listens_is_told_with_what_to_start() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(DeviceNotFoundError, match=rf"no palpate-ultraleap listens at 127\.0\.0\.1:{port} .*start it"):
        open_link(MODEL, serial=f"127.0.0.1:{port}")
    with pytest.raises(DeviceNotFoundError, match="no palpate-ultraleap listens at"):
        open_link(MODEL, serial=f"{'a' * 70}.invalid")  # no name of a host is so long


def open_to(script: Callable[[Peer], object], points: int = 1) -> str:
    """What opening and starting a link to a server says."""
    model = MODEL.with_points(points)
    with (
        ScriptedBridge(script) as server,
        pytest.raises(LinkError) as caught,
        open_link(model, serial=server.address) as link,
    ):
        link.start(1)
    assert server.address in str(caught.value)
    return f"{type(caught.value).__name__}: {caught.value}"


def test_servers_that_are_no_bridge_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link_module, "_HELLO_TIMEOUT", 0.2)
    monkeypatch.setattr(link_module, "_OPEN_TIMEOUT", 0.2)

    def answering(data: bytes) -> Callable[[Peer], object]:
        return lambda peer: (peer.take(), peer.give(data), peer.until_left())

    stranger = "LinkError: what listens at .* is no palpate-ultraleap: it sent "
    cases: list[tuple[Callable[[Peer], object], str]] = [
        (answering(b"HTTP/1.1 400 Bad Request\r\n\r\n"), stranger + "b'HTTP/1.1 400 Bad'"),
        (lambda peer: (peer.give(b"SSH-2.0-OpenSSH_9.6\r\n"), peer.until_left()), stranger + "b'SSH-2.0"),
        (answering(struct.pack("<4sI", b"HELO", (1 << 20) + 1)), stranger),
        (answering(message("HELO", b"PALPATEU")), stranger),
        (answering(message("HELO", bytes(24))), stranger),
        (answering(status()), stranger),
        (answering(b"HELO"), "DeviceTimeoutError: what listens at .* gave no answer of palpate-ultraleap in time"),
        (answering(b""), "DeviceTimeoutError: what listens at .* gave no answer"),
        (answering(greeting(version=2)), "LinkError: .* speaks version 2 of the protocol, this palpate 1"),
        (answering(message("FAIL", b"version 1 is not 2")), "LinkError: the bridge at .* says: version 1 is not 2"),
        (answering(message("FAIL", b"it is in use by 1.2.3.4")), "DeviceBusyError: .* it is in use by 1.2.3.4"),
        (lambda peer: peer.take(), "DeviceLostError: the bridge at .* is gone"),
        (answering(greeting() + message("OPEN")), "library takes nan$"),
        (answering(greeting() + message("OPEN", struct.pack("<d", 20e3))), "asked for 40000 .*library takes 20000$"),
        (answering(greeting()), "DeviceTimeoutError: .* gave no answer"),
    ]
    for script, wanted in cases:
        assert re.search(wanted, text := open_to(script)), (wanted, text)
    assert "takes 2 focal points a frame at most, not 4" in open_to(answering(greeting(points=2)), points=4)


def test_a_server_that_answers_a_byte_at_a_time_for_ever_does_not_hold_anyone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link_module, "_HELLO_TIMEOUT", 0.3)

    def dripping(peer: Peer) -> None:
        peer.take()
        data = struct.pack("<4sI", b"HELO", 1 << 20) + bytes(1 << 20)
        try:
            for value in data:
                peer.give(bytes([value]))
                time.sleep(0.02)
        except ConnectionError:
            return

    assert "gave no answer" in open_to(dripping)


def test_answers_may_come_in_pieces() -> None:
    foci, said = samples(50), []

    def script(peer: Peer) -> None:
        peer.take("HELO")
        peer.give(greeting(about="3.1 é\nUSX:9\nUSX"), piece=3)
        _, content = peer.take("OPEN")
        said.append(struct.unpack("<IId", content))
        peer.give(message("OPEN", struct.pack("<d", 40e3)), piece=1)
        said.append(peer.take("FOCI")[1])
        peer.take("PING")
        peer.give(status(50, begun=20, passed=3, dropped=0, dry=2, dry_samples=9, missed=4), piece=5)

    with ScriptedBridge(script) as server, open_link(MODEL, serial=server.address) as link:
        link.start(4)
        link.write(block(foci))
        now = link.status()
    assert said == [(1, 0, 10e3), foci.tobytes()]
    assert now is not None
    # 9 device samples at 40 kHz are two periods at 10 kHz; missed callbacks are underruns, too
    assert (now.frames_played, now.fifo_frames, now.underruns, now.starved_periods) == (23, 27, 6, 2)
    assert (link.serial, link.transport) == ("USX:9", "tcp")


def test_a_bridge_that_gives_no_answer_in_time_is_left_and_nothing_is_waited_for_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(link_module, "_ANSWER_TIMEOUT", 0.2)
    left = threading.Event()

    def script(peer: Peer) -> None:
        peer.greet()
        peer.take("FOCI")
        peer.take("PING")  # not answered
        assert left.wait(TIMEOUT)

    with ScriptedBridge(script) as server, open_link(MODEL, serial=server.address) as link:
        link.start(1)
        link.write(block(samples(8)))
        with pytest.raises(DeviceTimeoutError):
            link.status()
        with pytest.raises(DeviceLostError):
            link.send_off()
        left.set()


def test_a_status_that_was_asked_for_before_is_not_taken_for_the_answer_to_a_stop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The bridge is asked what waits without waiting for it; an old answer must not say that a later STOP was heard."""
    monkeypatch.setattr(link_module, "_LOOK_NS", 0)
    monkeypatch.setattr(link_module, "_ANSWER_TIMEOUT", 0.3)
    answers, left = [status(8, begun=8), status(8, begun=8)], threading.Event()

    def script(count: int, peer: Peer) -> None:
        peer.greet()
        peer.take("FOCI")
        peer.take("PING")
        peer.take("STOP")
        peer.give(b"".join(answers[:count]))
        assert left.wait(TIMEOUT)

    for count in (1, 2):
        left.clear()
        with ScriptedBridge(partial(script, count)) as server, open_link(MODEL, serial=server.address) as link:
            link.start(1)
            link.write(block(samples(8)))
            assert link.queue_frames <= 8  # no answer has come
            with pytest.raises(DeviceTimeoutError) if count == 1 else contextlib.nullcontext():
                link.send_off()
            left.set()


def test_silence_counts_as_handed_over_once_the_bridge_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """A library that asks for nothing is handed nothing, silence neither."""
    monkeypatch.setattr(link_module, "_STALL_NS", 200_000_000)
    sounds, silent = status(8, begun=2, dropped=6, intensity=1.0), status(8, begun=2, dropped=6)

    def script(answers: list[bytes], peer: Peer) -> None:
        peer.greet()
        peer.take("FOCI")
        peer.take("STOP")
        peer.give(answers[0])
        for answer in answers[1:]:
            peer.take("PING")
            peer.give(answer)

    with (
        ScriptedBridge(partial(script, [sounds, sounds, silent])) as server,
        open_link(MODEL, serial=server.address) as link,
    ):
        link.start(1)
        link.write(block(samples(8)))
        link.send_off()

    def asks_for_nothing(peer: Peer) -> None:
        peer.greet()
        peer.take("FOCI")
        peer.take("STOP")
        peer.give(sounds)
        with contextlib.suppress(Exception):  # until the link is closed
            while True:
                peer.take("PING")
                peer.give(sounds)

    with ScriptedBridge(asks_for_nothing) as server, open_link(MODEL, serial=server.address) as link:
        link.start(1)
        link.write(block(samples(8)))
        with pytest.raises(DeviceTimeoutError, match="handed no silence"):
            link.send_off()


def test_counts_that_cannot_be_are_told() -> None:
    for counts in ({"taken": 7}, {"taken": 9}, {"taken": 8, "begun": 9}, {"taken": 8, "begun": 8, "dropped": 1}):

        def script(peer: Peer, counts: dict[str, int] = counts) -> None:
            peer.greet()
            peer.take("FOCI")
            peer.take("PING")
            peer.give(status(**counts))

        with ScriptedBridge(script) as server, open_link(MODEL, serial=server.address) as link:
            link.start(1)
            link.write(block(samples(8)))
            with pytest.raises(LinkError, match="was sent 8 samples, but its bridge counts"):
                link.status()


def test_a_library_that_asks_for_nothing_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link_module, "_STALL_NS", 100_000_000)

    def script(peer: Peer) -> None:
        peer.take("HELO")
        peer.give(greeting(capacity=8))
        peer.give(message("OPEN", peer.take("OPEN")[1][8:]))
        taken = 0
        while True:
            try:
                name, content = peer.take()
            except (EOFError, ConnectionError):
                return
            taken += len(content) // 16
            assert taken <= 8, "more than there is room for"
            peer.give(b"" if name == "FOCI" else status(taken))

    with ScriptedBridge(script) as server, open_link(MODEL, serial=server.address) as link:
        link.start(1)
        with pytest.raises(DeviceTimeoutError, match="its library has asked for no samples for 1 s"):
            link.write(block(samples(9)))
        assert link.bytes_sent == 8 * 16


@pytest.mark.parametrize("fails_after", [1, 3000])
def test_what_a_bridge_says_as_it_fails_is_told_and_it_counts_as_silent(fails_after: int) -> None:
    bridge = PlayingBridge(fails_after=fails_after, refusal="the library lost its array")
    with ScriptedBridge(bridge) as server, open_link(MODEL, serial=server.address) as link:
        player = Player(link, limits=FREE)
        with pytest.raises(LinkError, match=r"says: the library lost its array$") as caught:
            player.play(blocks(samples(8000), 500), update_rate=40e3)
        assert not isinstance(caught.value, DeviceLostError)
        assert player.report is not None
        assert (player.report.stopped_by, player.report.off_sent, player.report.may_emit) == ("device", True, None)
        with pytest.raises(LinkError, match="says: the library lost its array"):
            link.write(block(samples(1)))
        with pytest.raises(LinkError, match="says: the library lost its array"):
            player.play([block(samples(1))], update_rate=40e3)


def test_a_bridge_that_reads_nothing_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Part of a message may be on its way, so nothing that followed would be understood."""

    left = threading.Event()

    def script(peer: Peer) -> None:
        peer.take("HELO")
        peer.give(greeting(capacity=1 << 30))
        peer.give(message("OPEN", peer.take("OPEN")[1][8:]))
        assert left.wait(TIMEOUT)

    def write_for_ever(link: Link) -> None:
        while True:
            link.write(block(samples(4096)))

    monkeypatch.setattr("palpate.device.boards.stratos.channel._SEND_TIMEOUT", 0.2)
    roomy = replace(MODEL, fifo_frames=1 << 30)  # more than sockets hold
    with ScriptedBridge(script) as server, open_link(roomy, serial=server.address) as link:
        link.start(1)
        with pytest.raises(DeviceTimeoutError, match=r"has read nothing for 0\.2 s, so the connection was closed"):
            write_for_ever(link)
        assert not link.is_exact
        with pytest.raises(DeviceLostError):
            link.send_off()
        left.set()


def test_an_exception_in_the_blocks_passes_through_with_the_array_silent() -> None:
    bridge = emulated()

    def failing() -> Iterator[array[int]]:
        yield from blocks(samples(5000), 500)
        raise KeyError("of the caller")

    with open_link(MODEL, backend=bridge) as link:
        with pytest.raises(KeyError, match="of the caller") as caught:
            Player(link, limits=FREE).play(failing(), update_rate=40e3)
        assert bridge.board().intensity == 0
    report = caught.value.report  # type: ignore[attr-defined]  # `attach_report` sets it
    assert (report.stopped_by, report.off_sent) == ("exception", True)


@pytest.mark.parametrize(
    ("limits", "field"),
    [(Limits(on_time_max=0.05), "on_time_max"), (Limits(duty_max=0.01, duty_window=10.0), "duty_max")],
)
def test_limits_end_a_playback_in_silence(limits: Limits, field: str) -> None:
    bridge = emulated()
    loud = samples(20_000)
    loud[..., 3] = 1
    with open_link(MODEL, backend=bridge) as link:
        with pytest.raises(SafetyLimitError, match=rf"\({field}\)") as caught:
            Player(link, limits=limits).play(blocks(loud, 1000), update_rate=40e3)
        assert bridge.board().intensity == 0
    assert caught.value.report is not None
    assert caught.value.report.stopped_by == "limit"
    assert len(played(bridge)) <= (0.05 if field == "on_time_max" else 0.1) * 40e3
