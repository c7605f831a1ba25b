"""Decoders of each board's frames, written from docs/guide/boards.md and docs/formats/emulator.md alone."""

from __future__ import annotations

import cmath
import math

Drive = dict[tuple[float, float], tuple[float, float]]  # (x, y) [mm] -> delay [turns], pressure amplitude 0..1

GRID = [round(-78.75 + 10.5 * step, 2) for step in range(16)]


def _emulator(frame: bytes) -> Drive:
    drive = {}
    for slot in range(256):
        column, step = divmod(slot, 16)
        y = GRID[15 - step] if column % 2 == 0 else GRID[step]
        drive[GRID[15 - column], y] = frame[2 * slot] / 256, frame[2 * slot + 1] / 255
    return drive


def _pat16(frame: bytes) -> Drive:
    """The fundamental of each pin's pulse, 128 steps a period, less the quarter turn that all have."""
    if not frame[0] & 0x80:
        raise ValueError("no start flag")
    drive = {}
    for column in range(16):
        for row in range(16):  # row 0 is at +y
            pair = {0: (1, 5), 1: (0, 4), 2: (3, 6), 3: (2, 7)}[column % 4]
            pin = 64 * (3 - column // 4) + 8 * (7 - row // 2) + pair[row % 2]
            start, width = frame[pin] & 0x7F, frame[256 + pin] & 0x7F
            wave = sum(cmath.exp(-2j * math.pi * (step + 0.5) / 128) for step in range(start, start + width))
            drive[GRID[column], GRID[15 - row]] = (
                (-cmath.phase(wave) / (2 * math.pi) - 0.25) % 1,
                abs(wave) * math.sin(math.pi / 128),
            )
    return drive


def _sonicsurface(frame: bytes) -> Drive:
    """The board's own reader: 0xFE starts, others fill the back buffer, 0xFD swaps."""
    back, front, place = [32] * 256, [32] * 256, 0
    for byte in frame:
        if byte == 0xFE:
            place = 0
        elif byte == 0xFD:
            back, front, place = front, back, 0
        elif byte in (0x96, 0x97, 0xC0, 0xC1):
            raise ValueError(f"command {byte:#x} inside a frame")
        else:
            back[place] = byte
            place += 1
    drive = {}
    for row in range(16):  # row 0 is at -y
        for column in range(16):
            quad = ((0, 7, 1, 2), (4, 3, 6, 5))[row % 2][column % 4]
            value = front[64 * (column // 4) + 8 * (row // 2) + quad]
            drive[GRID[column], GRID[row]] = (value % 32 / 32, float(value != 32))
    return drive


def _autd3(frame: bytes) -> Drive:
    places = [(i, j) for j in range(14) for i in range(18) if (i, j) not in {(1, 1), (2, 1), (16, 1)}]
    return {
        (round(10.16 * i - 86.36, 2), round(10.16 * j - 66.04, 2)): (frame[t] / 256, frame[249 + t] / 255)
        for t, (i, j) in enumerate(places)
    }


DECODERS = {"emulator": _emulator, "pat16": _pat16, "sonicsurface": _sonicsurface, "autd3": _autd3}
