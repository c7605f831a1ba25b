"""The model of the SonicSurface against the board's published VHDL, run by a VHDL simulator.

The source is not ours to ship: `PALPATE_SONICSURFACE` names a checkout of github.com/upnalab/SonicSurface (compared at
commit 666c2dd5). tests/device/boards/gateware/sonic_bench.vhd wires the entities as the published QuadrupleBuffer.bdf
does, with bytes 48 clocks apart instead of 450; uart_bench.vhd runs the UART at its published 45 clocks a bit.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from palpate.device import Player, VirtualClock, array_model, encode_frames, open_link
from palpate.device.boards.sonicsurface.model import SonicBoard
from palpate.device.registry import emulated_backend

SOURCE = os.environ.get("PALPATE_SONICSURFACE", "")
pytestmark = [
    pytest.mark.skipif(
        not SOURCE, reason="not run: PALPATE_SONICSURFACE names no checkout of github.com/upnalab/SonicSurface"
    ),
    pytest.mark.skipif(shutil.which("ghdl") is None, reason="not run: ghdl (Debian's package) is not installed"),
]

OPTIONS = ("--std=93c", "-fsynopsys", "-fexplicit")
ENTITIES = ("Counter", "Distribute", "PulseExpander", "LatchBuffer", "PhaseLine", "Mux8", "AllChannels")
UART = ("RSSFilter_1", "UARTReader")
LOOK = 256  # in a list of bytes: compare what is emitted here
START, SWAP, CLOCKS_OFF, CLOCKS_ON, PRIMARY, SECONDARY = 0xFE, 0xFD, 0x96, 0x97, 0xC0, 0xC1
COMMANDS = {START, SWAP, CLOCKS_OFF, CLOCKS_ON, PRIMARY, SECONDARY}
OFF = [START, *[32] * 256, SWAP]
CLOCK_PS = 97_656  # 10.24 MHz

Emission = list[tuple[int, int] | None]
"""Of each place: steps of 32 that its pulse is high and the step that it rises in; None where it has no pulse."""


@pytest.fixture(scope="module", params=["primary", "secondary"])
def board(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """Which board, and a folder in which its published entities are analysed."""
    return request.param, analysed(request.param, tmp_path_factory.mktemp(request.param))


def analysed(board: str, folder: Path) -> Path:
    source = Path(SOURCE) / "Firmware" / f"FPGA {board}" / "src"
    own = Path(__file__).parent / "gateware"
    files = [*(source / f"{name}.vhd" for name in (*ENTITIES, *UART)), own / "sonic_bench.vhd", own / "uart_bench.vhd"]
    subprocess.run(["ghdl", "-a", *OPTIONS, *map(str, files)], cwd=folder, check=True, capture_output=True)
    return folder


def simulated(bench: str, folder: Path, values: list[int], **generics: int) -> list[list[int]]:
    """The rows of numbers that a bench writes for those that it reads."""
    (folder / "in.txt").write_text("\n".join(map(str, values)) + "\n")
    options = [f"-g{name}={value}" for name, value in {"INPUT": "in.txt", "OUTPUT": "out.txt", **generics}.items()]
    subprocess.run(["ghdl", "-r", *OPTIONS, bench, *options], cwd=folder, check=True, capture_output=True)
    return [list(map(int, row.split())) for row in (folder / "out.txt").read_text().splitlines()]


def by_gateware(folder: Path, values: list[int]) -> list[Emission]:
    """What the published entities emit at each look; nothing while the shift clocks are off."""
    emissions: list[Emission] = []
    for clocks_on, *numbers in simulated("sonic_bench", folder, values):
        pulses = zip(numbers[::2], numbers[1::2], strict=True)
        emissions.append([(high, rise) if high and clocks_on else None for high, rise in pulses])
    return emissions


def by_model(values: list[int], *, secondary: bool) -> list[Emission]:
    """The same of the model: pulses of 16 steps, one step behind their delay, which is the same for all places."""
    clock = VirtualClock()
    board = SonicBoard(clock, chip_bytes=1, secondary=secondary)
    board.set_line(board.baud)
    emissions: list[Emission] = []
    for value in values:
        if value == LOOK:
            delays = board.playing.tolist() if board.emitting else [32] * 256
            emissions.append([None if delay == 32 else (16, (delay + 1) % 32) for delay in delays])
            continue
        assert board.accept(memoryview(bytes([value]))) == 1
        clock.advance(11 / board.baud)
    return emissions


def stream(seed: int) -> list[int]:
    """Frames, swaps, commands, torn frames, data above 32 and data without a start, with a look after each."""
    random = np.random.default_rng(seed)
    any_datum = [value for value in range(256) if value not in COMMANDS]
    values: list[int] = [LOOK]
    for _ in range(30):
        kind = random.choice(["frame", "torn", "swap", "off", "clocks", "board", "bare"])
        if kind == "frame":
            values += [START, *random.choice(any_datum, 256).tolist(), SWAP]
        elif kind == "torn":
            values += [START, *random.choice(any_datum, random.integers(0, 256)).tolist()]
        elif kind == "bare":  # behind a swap, so that no more than 256 data follow each other
            values += [SWAP, *random.choice(any_datum, random.integers(1, 256)).tolist(), SWAP]
        elif kind == "swap":
            values += [SWAP] * int(random.integers(1, 4))
        elif kind == "off":
            values += OFF * int(random.integers(1, 3))
        elif kind == "clocks":
            values.append(int(random.choice([CLOCKS_OFF, CLOCKS_ON, CLOCKS_ON])))
        else:
            values.append(int(random.choice([PRIMARY, SECONDARY])))
        values.append(LOOK)
    return values


def test_from_power_up_one_off_frame_is_undone_by_a_swap_and_two_are_not(board: tuple[str, Path]) -> None:
    emitted = by_gateware(board[1], [LOOK, *OFF, LOOK, SWAP, LOOK, *OFF * 2, LOOK, SWAP, LOOK])
    places = [len([pulse for pulse in emission if pulse]) for emission in emitted]
    assert places == [256, 0, 256, 0, 0]
    assert len(set(emitted[0])) == 1  # in phase


@pytest.mark.parametrize("seed", range(4))
def test_the_model_emits_what_the_published_entities_emit(seed: int, board: tuple[str, Path]) -> None:
    name, folder = board
    values = stream(seed)
    gateware = by_gateware(folder, values)
    assert len(gateware) == values.count(LOOK) == 31
    assert gateware == by_model(values, secondary=name == "secondary")


def test_the_uart_reads_senders_4_4_percent_slow_to_3_3_percent_fast(board: tuple[str, Path]) -> None:
    random = np.random.default_rng(1)
    values = random.integers(0, 256, 1500).tolist()
    read = {
        percent: simulated(
            "uart_bench", board[1], values, BIT_PS=round(1e12 / 230_400 / (1 + percent / 100)), CLOCK_PS=CLOCK_PS
        )
        for percent in (-4.4, 0.0, 3.3, 4.0)
    }
    assert [percent for percent, rows in read.items() if rows == [[value] for value in values]] == [-4.4, 0.0, 3.3]


def test_single_swaps_show_and_hide_one_pattern_on_the_primary_board_and_nothing_on_the_secondary(
    board: tuple[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = sent_bytes(monkeypatch)
    model = array_model("sonicsurface")
    on = [False, True, True, False, True, False, False]
    delay = np.random.default_rng(6).random(256)
    wire = encode_frames(np.tile(delay, (len(on), 1)), np.array(on, float), array=model)
    with open_link(model, backend=emulated_backend("sonicsurface", clock=VirtualClock())) as link:
        Player(link).play([wire], update_rate=model.update_rate(5))
    start = index_of(sent, wire[1, :-1].tolist()) + 257
    slots = [sent[start + 5 * place : start + 5 * place + 5] for place in range(len(on))]
    emitted = by_gateware(board[1], [*sent[:start], *(value for slot in slots for value in (*slot, LOOK))])
    pattern = [(16, (int(phase) + 1) % 32) for phase in wire[1, 1:-1]]  # a step behind the delay, as all places are
    expected = [pattern if shown and board[0] == "primary" else [None] * 256 for shown in on]
    assert emitted == expected


@pytest.mark.parametrize("left", [[], [SECONDARY, CLOCKS_OFF, START, *range(100)]])
def test_both_boards_are_silent_after_a_playback_even_if_a_swap_is_read_out_of_noise(
    left: list[int], board: tuple[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = sent_bytes(monkeypatch)
    sent += left
    model = array_model("sonicsurface")
    random = np.random.default_rng(5)
    wire = encode_frames(random.random((3, 256)), np.ones(3), array=model)
    ports = emulated_backend("sonicsurface", clock=VirtualClock())
    with open_link(model, backend=ports) as link:
        Player(link).play([wire], update_rate=model.update_rate(model.divider_default))
    start = index_of(sent, wire[0].tolist())
    emitted = by_gateware(board[1], [*sent[:start], LOOK, *sent[start:], LOOK, SWAP, LOOK])
    assert emitted == [[None] * 256] * 3


def sent_bytes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list that gets every byte that emulated boards take from here on."""
    sent: list[int] = []
    accept = SonicBoard.accept

    def note(board: SonicBoard, data: memoryview) -> int:
        count = accept(board, data)
        sent.extend(data[:count])
        return count

    monkeypatch.setattr(SonicBoard, "accept", note)
    return sent


def index_of(values: list[int], part: list[int]) -> int:
    """Where a part of a list begins in it."""
    return next(i for i in range(len(values)) if values[i : i + len(part)] == part)
