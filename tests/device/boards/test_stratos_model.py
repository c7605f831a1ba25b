"""The model of the bridge against docs/formats/ultraleap-bridge.md, read a second time by `bridge_oracle`."""

from __future__ import annotations

import re
import struct
from itertools import pairwise

import numpy as np
import pytest
from bridge_cases import HELLO, counts_of, message, messages, opening, samples
from bridge_oracle import handed_over
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.device import VirtualClock
from palpate.device.boards.stratos.model import BridgeModel


class Client:
    """Talks to a model of which every sample is kept."""

    def __init__(self, *, points: int = 1, rate: float = 40e3) -> None:
        self.clock = VirtualClock()
        self.model = BridgeModel(self.clock, "USX:1", record=1 << 20)
        self.say(HELLO + opening(points, rate))

    def say(self, data: bytes) -> list[tuple[str, bytes]]:
        answers, stays = self.model.receive(data)
        found = messages(answers)
        assert stays == ("FAIL" not in dict(found))
        return found

    def counts(self) -> dict[str, float]:
        ((name, content),) = self.say(message("PING"))
        assert name == "STAT"
        return counts_of(content)

    def begun(self) -> list[tuple[bytes, int]]:
        """Samples that have begun by now, and when [ns]."""
        self.counts()
        return list(self.model.played)


def sent(foci: np.ndarray) -> bytes:
    return message("FOCI", foci.tobytes())


def test_the_first_answers_say_what_it_is_and_what_its_library_takes() -> None:
    model = BridgeModel(VirtualClock(), "USX:1")
    answers, stays = model.receive(HELLO + opening(4, 10e3))
    (hello, content), (opened, rate) = messages(answers)
    assert stays
    assert (hello, opened) == ("HELO", "OPEN")
    assert struct.unpack_from("<8sIIII", content) == (b"PALPATEU", 1, 4096, 8, 0)
    assert content[24:].decode().split("\n") == ["emulated", "USX:1", "USX"]
    assert struct.unpack("<d", rate) == (10e3,)  # a fourth of 40 kHz for four focal points


ONE = samples(1)
BAD = {
    "another first message": (b"", message("PING"), "first message"),
    "another program": (b"", message("HELO", b"PALPATEX" + struct.pack("<I", 1)), "first message"),
    "a greeting cut short": (b"", message("HELO", b"PALPATEU\1"), "first message"),
    "another version": (b"", message("HELO", b"PALPATEU" + struct.pack("<I", 2)), "version 2 .* not 1"),
    "no points": (HELLO, opening(0), "1 to 8 focal points, not 0"),
    "nine points": (HELLO, opening(9), "1 to 8 focal points, not 9"),
    "a rate above the library's": (HELLO, opening(4, 10001.0), "10001 Hz is outside 1 to 10000 Hz.* 4 focal points"),
    "no rate": (HELLO, opening(1, 0.0), "a rate of 0 Hz is outside"),
    "a rate that is not finite": (HELLO, opening(1, float("nan")), "a rate of nan Hz is outside"),
    "an opening cut short": (HELLO, message("OPEN", bytes(15)), "15 bytes instead of 16"),
    "samples before OPEN": (HELLO, sent(ONE), "before OPEN"),
    "half a sample": (HELLO + opening(), message("FOCI", bytes(24)), "24 bytes are no whole number"),
    "a sample of one point for two": (HELLO + opening(2, 20e3), sent(ONE), "16 bytes are no whole number"),
    "an intensity above 1": (HELLO + opening(), sent(ONE * [1, 1, 1, 20]), "sample 0 .* 0..1"),
    "an intensity below 0": (HELLO + opening(), sent(ONE * [1, 1, 1, -1]), "sample 0 .* 0..1"),
    "a place that is none": (HELLO + opening(), sent(np.concatenate([ONE, ONE * np.nan])), "sample 1 .* not finite"),
    "more than there is room for": (HELLO + opening(), sent(samples(4097)), "room for 4096 samples, not 4097"),
    "an unknown message": (HELLO + opening(), message("FOCU"), "FOCU.* is not known"),
    "a message beyond 1 MiB": (HELLO + opening(), struct.pack("<4sI", b"FOCI", (1 << 20) + 1), "longer than 1 MiB"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_it_cannot_take_is_refused_and_it_is_silent(case: str) -> None:
    before, bad, reason = BAD[case]
    clock = VirtualClock()
    model = BridgeModel(clock, "USX:1")
    _, stays = model.receive(before)
    assert stays
    if b"OPEN" in before and before.endswith(opening()):
        model.receive(sent(ONE))
        clock.advance(1e-3)
        assert model.intensity == ONE[0, 0, 3]
        reason = reason.replace("sample 0", "sample 1").replace("sample 1 .* not f", "sample 2 .* not f")
    answers, stays = model.receive(bad)
    ((name, text),) = messages(answers)
    assert (name, stays, model.intensity) == ("FAIL", False, 0)
    assert re.search(reason, text.decode())
    model.leave()
    assert model.receive(HELLO + opening() + sent(ONE))[1]  # the next client is taken


def test_numbers_of_samples_and_counts_begin_anew_with_each_opening() -> None:
    client = Client()
    client.say(sent(samples(10)))
    client.clock.advance(100e-6)  # samples 0 to 4
    assert client.counts()["begun"] == 5
    client.say(opening(2, 20e3))
    counts = client.counts()
    assert (counts["taken"], counts["begun"], counts["dropped"], counts["intensity"]) == (0, 0, 0, 0)
    assert client.model.frames_played == 5  # of the model


def test_the_last_sample_is_held_for_a_tenth_of_a_second_and_then_silent() -> None:
    client = Client(rate=10e3)
    client.say(sent(samples(1)))
    client.clock.advance(0.1 + 99e-6)  # it is due for 100 us, then held
    assert client.counts()["intensity"] > 0
    client.clock.advance(2e-6)
    counts = client.counts()
    assert (counts["intensity"], counts["dry"], counts["dry_samples"]) == (0, 1, 4001)  # 0.1 s at 40 kHz
    client.clock.advance(1.0)
    assert client.counts()["dry_samples"] == 44_001  # until the next one begins
    client.say(sent(samples(1)))
    client.clock.advance(50e-6)
    assert client.counts()["dry_samples"] == 44_001  # it began with the next device sample


def test_a_pause_after_a_silent_sample_is_no_running_dry() -> None:
    client = Client()
    foci = samples(4)
    foci[-1, :, 3] = 0
    for _ in range(3):
        client.say(sent(foci))
        client.clock.advance(0.3)
    counts = client.counts()
    assert (counts["begun"], counts["dry"], counts["dry_samples"]) == (12, 0, 0)


def test_the_next_sample_after_a_dry_time_begins_at_once_and_the_others_a_period_apart() -> None:
    client = Client(rate=10e3)
    client.say(sent(samples(1)))
    client.clock.advance(0.05)
    client.say(sent(samples(3)))
    client.clock.advance(1e-3)
    begun = [began_ns for _, began_ns in client.begun()]
    assert begun == [0, 50_000_000, 50_100_000, 50_200_000]
    assert [client.model.began_ns(number) for number in range(5)] == [*begun, None]


def test_stop_drops_what_waits_and_is_silent_at_once() -> None:
    client = Client()
    client.say(sent(samples(100)))
    client.clock.advance(30e-6)
    ((name, content),) = client.say(message("STOP"))
    counts = counts_of(content)
    assert (name, counts["taken"], counts["begun"], counts["dropped"]) == ("STAT", 100, 2, 98)
    assert counts["intensity"] == client.model.intensity == 0
    client.clock.advance(1.0)
    assert client.model.frames_played == 2


def test_a_client_that_says_nothing_for_half_a_second_while_samples_wait_is_left() -> None:
    client = Client(rate=1e3)
    client.say(sent(samples(1000)))
    client.clock.advance(0.499)
    assert client.counts()["begun"] == 500
    client.clock.advance(0.501)
    assert client.model.intensity == 0
    ((name, text),) = client.say(message("PING"))
    assert (name, text.decode()) == ("FAIL", "nothing was heard for 0.5 s")
    assert client.model.frames_played == 1000 * (0.499 + 0.5) + 1


def test_a_client_that_says_nothing_while_nothing_sounds_is_waited_for() -> None:
    client = Client()
    client.say(sent(samples(4)))
    client.clock.advance(3600.0)
    client.say(sent(samples(4)))
    client.clock.advance(0.01)
    assert client.counts()["begun"] == 8


def test_a_client_that_leaves_leaves_silence_and_nothing_of_its_messages() -> None:
    client = Client()
    client.say(sent(samples(100)) + message("FOCI", bytes(64))[:20])
    client.clock.advance(1e-3)
    client.model.leave()
    assert (client.model.intensity, client.model.frames_played) == (0, 41)
    client.clock.advance(1.0)
    assert client.model.frames_played == 41
    assert [name for name, _ in client.say(HELLO + opening() + message("PING"))] == ["HELO", "OPEN", "STAT"]


def test_no_rate_drifts_in_an_hour() -> None:
    for divider in (1, 3, 7, 255):
        client = Client(rate=40e3 / divider)
        period_ns = 25_000 * divider
        sample = samples(1)
        for hour in (0, 1):  # the sample that begins an hour after the first, in its own place
            client.clock.advance(hour * 3600.0 - client.clock.now_ns() % period_ns * 1e-9)
            client.say(sent(sample))
        client.say(sent(samples(4000)))
        client.clock.advance(0.1)
        first, second, *others = (began_ns for _, began_ns in client.begun())
        assert (first, second % 25_000) == (0, 0)  # at a device sample
        assert set(np.diff([second, *others])) == {period_ns}


EVENT = st.tuples(
    st.integers(1, 4_000_000),  # [ns] after the one before
    st.one_of(st.none(), st.lists(st.sampled_from([0.0, 0.5, 1.0]), min_size=1, max_size=40)),
)


@settings(max_examples=40)
@given(
    events=st.lists(EVENT, min_size=1, max_size=6),
    points=st.integers(1, 3),
    divider=st.integers(1, 9),
    pause=st.sampled_from([0, 30_000_000, 99_990_001, 150_000_000]),
)
def test_it_hands_over_what_the_specification_says(
    events: list[tuple[int, list[float] | None]], points: int, divider: int, pause: int
) -> None:
    divider = max(divider, points)  # the rate of so many points is no higher
    client, placed, time_ns = Client(points=points, rate=40_000 / divider), [], 0
    for number, (after_ns, levels) in enumerate(events):
        time_ns += after_ns + (pause if number == 1 else 0)
        time_ns += time_ns % 25_000 == 0  # at no device sample
        placed.append((time_ns, levels))
    end_ns = time_ns + 110_000_001
    wanted = handed_over(placed, divider=divider, points=points, end_ns=end_ns)
    marked = samples(400, points)  # no two alike
    first = 0
    for when_ns, levels in placed:
        client.clock.sleep_until_ns(when_ns)
        if levels is None:
            client.say(message("STOP"))
            continue
        foci = marked[first : first + len(levels)]
        foci[:, :, 3] = np.float32(levels)[:, None]
        first += len(levels)
        client.say(sent(foci))
    client.clock.sleep_until_ns(end_ns)
    counts = client.counts()
    assert client.begun() == [(marked[name].tobytes(), began_ns) for name, began_ns in wanted.begun]
    assert counts["dropped"] == wanted.dropped
    assert (counts["dry"], counts["dry_samples"]) == (wanted.dry, wanted.dry_samples)
    assert counts["intensity"] == wanted.sounding[-1] == 0


@settings(max_examples=40)
@given(cuts=st.lists(st.integers(1, 400), max_size=30), seed=st.integers(0, 1000))
def test_messages_may_come_in_any_pieces(cuts: list[int], seed: int) -> None:
    foci = samples(50, seed=seed)
    parts = np.split(foci, sorted({n % 50 for n in cuts}))
    data = HELLO + opening() + b"".join(sent(part) + message("PING") for part in parts)
    client = Client()
    client.model.leave()
    places = np.minimum(np.cumsum([0, *cuts, len(data)]), len(data))
    heard = [client.say(data[first:stop]) for first, stop in pairwise(places.tolist())]
    names = [name for answers in heard for name, _ in answers]
    assert names == ["HELO", "OPEN", *["STAT"] * len(parts)]
    client.clock.advance(0.01)
    assert b"".join(sample for sample, _ in client.begun()) == foci.tobytes()
    assert client.counts()["taken"] == 50
