"""The model of the PAT board against the published gateware itself, run by a VHDL simulator.

The source is not ours to ship: `PALPATE_OPENMPD_HARDWARE` names a checkout of github.com/RMResearch/OpenMPD_Hardware.
Its FrameBufferController and CommandReader run as they are for what a playback sends (some minutes a test); for random
streams 1 s is made 2 ms, so that a clear of the FIFO takes seconds to simulate. The vendor's FIFO is replaced by
tests/device/boards/gateware/fifo.vhd.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from palpate.device import Player, VirtualClock, array_model, encode_frames, open_link
from palpate.device.boards.pat16 import model as pat_board
from palpate.device.boards.pat16.model import PatBoard
from palpate.device.registry import emulated_backend

SOURCE = os.environ.get("PALPATE_OPENMPD_HARDWARE", "")
pytestmark = [
    pytest.mark.skipif(not SOURCE, reason="PALPATE_OPENMPD_HARDWARE names no checkout of OpenMPD_Hardware"),
    pytest.mark.skipif(shutil.which("ghdl") is None, reason="ghdl (Debian's package) is not installed"),
]

CLOCK_NS = 20
SECOND_NS = 2_000_000  # what stands for a second here
CHIP_CLOCKS = 5  # a byte each 100 ns
ONE_SECOND = '"10111110101111000001111111"'  # 49,999,999 clocks, in the gateware
OPTIONS = ("--std=93c", "-fsynopsys", "-fexplicit")
END_NS = 5 * SECOND_NS
POWER_NS = 1_010_000_000  # when the playbacks begin: the board is deaf for a second

MIF = Path(SOURCE) / "FPGA_3.4.2" / "amplituderam.mif"  # commit d3b4e57 has it, later ones do not

Burst = tuple[int, bytes]  # when it is on the bus [ns], and what it is


def analysed(folder: Path, second_ns: int) -> Path:
    """A folder in which the gateware is analysed, its second as long as that."""
    own = Path(__file__).parent / "gateware"
    second = f'"{second_ns // CLOCK_NS - 1:026b}"'
    sources = [own / "fifo.vhd", own / "bench.vhd"]
    for name in ("FrameBufferController.vhd", "CommandReader.vhd"):
        text = (Path(SOURCE) / "FPGA_3.4.2" / "src" / name).read_text(errors="replace")
        assert text.count(ONE_SECOND) == (2 if name.startswith("Frame") else 0)
        (folder / name).write_text(text.replace(ONE_SECOND, second))
        sources.insert(1, folder / name)
    subprocess.run(["ghdl", "-a", *OPTIONS, *map(str, sources)], cwd=folder, check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The gateware with a short second."""
    return analysed(tmp_path_factory.mktemp("ghdl"), SECOND_NS)


def by_gateware(bench: Path, bursts: list[Burst], folder: Path, end_ns: int = END_NS) -> list[tuple[int, int, bytes]]:
    """When each frame was swapped in [ns], the divider then, and the frame, its flags left out."""
    rows = [f"{time_ns // CLOCK_NS} {byte}" for time_ns, data in bursts for byte in data]
    (folder / "bytes.txt").write_text("\n".join(rows) + "\n")
    generics = {
        "INPUT": folder / "bytes.txt",
        "OUTPUT": folder / "frames.txt",
        "CHIP_CLOCKS": CHIP_CLOCKS,
        "END_CLOCK": end_ns // CLOCK_NS,
    }
    command = ["ghdl", "-r", *OPTIONS, "bench", *(f"-g{name}={value}" for name, value in generics.items())]
    subprocess.run(command, cwd=bench, check=True, capture_output=True)
    swaps = []
    for line in (folder / "frames.txt").read_text().splitlines():
        clock, divider, *values = map(int, re.split(r"\s+", line.strip()))
        swaps.append((clock * CLOCK_NS, divider or 256, bytes(values)))
    return swaps[1:]  # the first is the off frame of the power-up


def by_model(bursts: list[Burst], monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, bytes]]:
    """When each block was taken that completed a frame [ns], and the frame, its flags left out."""
    monkeypatch.setattr(pat_board, "STALE_NS", SECOND_NS)
    monkeypatch.setattr(pat_board, "POWER_UP_NS", SECOND_NS)
    clock = VirtualClock()
    board = PatBoard(clock, record=10_000, chip_bytes=1 << 20, byte_rate=1e9 / (CHIP_CLOCKS * CLOCK_NS))
    for time_ns, data in bursts:
        clock.sleep_until_ns(time_ns)
        assert board.accept(memoryview(data)) == len(data)
    clock.sleep_until_ns(END_NS)
    frames = board.played & 0x7F
    played = zip(board.played_ns.tolist(), (frame.tobytes() for frame in frames), strict=True)
    in_time_ns = END_NS - pat_board.READ_NS - 500  # later the simulation ends while the block is read
    return [(time_ns, content) for time_ns, content in played if time_ns < in_time_ns]


def frame(random: np.random.Generator, divider: int | None = None) -> bytes:
    wire = random.integers(0, 128, 512).astype(np.uint8)
    wire[0] |= 0x80
    if divider is not None:
        bits = np.unpackbits(np.array([divider], np.uint8), bitorder="little")
        wire[26:34] |= bits * np.uint8(0x80)
        wire[34] |= 0x80
    return wire.tobytes()


def stream(seed: int) -> list[Burst]:
    """Frames, torn frames, zeros and noise, at once or after pauses in which the FIFO is cleared or nearly so."""
    random = np.random.default_rng(seed)
    time_ns, bursts = SECOND_NS + 30_000, []
    while time_ns < 4 * SECOND_NS:
        kind = random.choice(["frames", "torn", "zeros", "noise", "slow"])
        if kind == "frames":
            data = b"".join(frame(random) for _ in range(random.integers(1, 12)))
        elif kind == "slow":
            data = frame(random, int(random.choice([0, 1, 2, 3, 8, 255]))) + frame(random) * 2 + frame(random, 2)
        elif kind == "torn":
            data = frame(random)[: random.integers(1, 512)]
        elif kind == "zeros":
            data = bytes(random.integers(1, 1100))
        else:
            data = random.integers(0, 256, random.integers(1, 700)).astype(np.uint8).tobytes()
        bursts.append((time_ns, data))
        pause_ns = random.choice([0, 100_000, 500_000, 19 * SECOND_NS // 20, 21 * SECOND_NS // 20])
        time_ns += int(pause_ns + random.integers(0, 100_000)) // CLOCK_NS * CLOCK_NS
    return bursts


@pytest.mark.skipif(not MIF.is_file(), reason="not run: the checkout has no amplituderam.mif, as commit d3b4e57 has")
def test_the_memory_of_amplitudes_begins_as_the_model_emits_at_power_up() -> None:
    words = re.findall(r"^\s*\d+ : ([0-9A-F]{56});", MIF.read_text(), re.MULTILINE)
    assert len(words) == 16  # two buffers of eight words of 32 values of 7 bits
    values = [int(word, 16) >> 7 * place & 0x7F for word in words for place in range(32)]
    duty = PatBoard(VirtualClock()).playing[256:].tolist()
    assert values == duty + duty


@pytest.mark.parametrize("seed", range(40))
def test_the_model_plays_what_the_gateware_plays_when_the_gateware_plays_it(
    seed: int, bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bursts = stream(seed)
    model = by_model(bursts, monkeypatch)
    gateware = by_gateware(bench, bursts, tmp_path)[: len(model)]
    assert len(gateware) >= 1
    assert [content for _, _, content in gateware] == [content for _, content in model]
    late_ns = np.array([swap[0] for swap in gateware]) - np.array([take[0] for take in model])
    assert late_ns.min() >= 0  # a frame is swapped in while its block is read
    assert late_ns.max() <= pat_board.READ_NS + 500


@pytest.mark.parametrize(("residue", "torn"), [(0, 0), (300, 37), (511, 511)])
def test_the_gateware_plays_every_frame_of_a_playback_and_ends_off_whatever_it_was_left_with(
    residue: int, torn: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = emulated_backend("pat16", clock=(clock := VirtualClock()))
    sent: list[Burst] = []
    accept = PatBoard.accept

    def note(board: PatBoard, data: memoryview, *, since_ns: int | None = None) -> int:
        count = accept(board, data, since_ns=since_ns)
        sent.append((POWER_NS + (clock.now_ns() if since_ns is None else since_ns), bytes(data[:count])))
        return count

    monkeypatch.setattr(PatBoard, "accept", note)
    random = np.random.default_rng(residue)
    left = frame(random) + bytes(512 - torn) + frame(random)[:torn] + frame(random)[:residue]
    assert bus.board().accept(memoryview(left[:1024])) == 1024
    clock.advance(0.001)
    assert bus.board().accept(memoryview(left[1024:])) == len(left) - 1024
    clock.advance(0.3)
    model = array_model("pat16")
    wire = encode_frames(random.random((20, 256)), np.ones(20), array=model)
    with open_link(model, backend=bus) as link:
        Player(link).play([wire], update_rate=10e3)
    end_ns = POWER_NS + clock.now_ns() + 1_200_000_000  # a clear comes within it
    swaps = by_gateware(analysed(tmp_path, 1_000_000_000), sent, tmp_path, end_ns)
    played = [content for _, _, content in swaps if any(content[256:])]
    assert played[-20:] == [content.tobytes() for content in wire & 0x7F]
    assert len(played) <= 20 + 1 + (torn > 0)  # what the board was left with
    assert not any(swaps[-1][2][256:])
