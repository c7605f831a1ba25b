"""A device on the buses of the test tiers: standard requests and descriptor bytes, around a model of palpate.device.

The models (board, and USB chip in front of it) import nothing of links and codecs. NumPy is all that this needs.
"""

from __future__ import annotations

import struct

import numpy as np

from palpate.device.boards.emulator.model import Board, EmulatorUsb
from palpate.device.boards.pat16.ftdi_model import FT232H_CHIP_BYTES, Ft232h
from palpate.device.boards.pat16.model import PatBoard
from palpate.device.emulation.peripheral import Peripheral

ON_FOR_NS = 10_000_000_000  # how long the board has been switched on when the bus is made
STANDARD_IN, GET_DESCRIPTOR = 0x80, 0x06
DEVICE, CONFIGURATION, STRING = 1, 2, 3
SPEED = {2: "12", 3: "480"}  # libusb's number: Linux's word [Mbit/s]


class Chip:
    """One device. `control` returns None for a stall, `accept` takes what there is room for."""

    def __init__(self, device: Peripheral, *, step_bytes: int) -> None:
        own = device.descriptors
        self.device, self.board, self.serial = device, device.board, own.serial
        self.step_bytes = step_bytes  # a part of the FIFO, so that what it lacks is made up for as soon as it is read
        self.vendor, self.product, self.speed = own.vendor, own.product, SPEED[own.speed]
        self.strings = (own.manufacturer_string, own.product_string, own.serial)
        self.endpoints = dict.fromkeys(own.endpoints, own.packet_bytes)
        self.accept, self.room_at_ns = device.accept, device.room_at_ns
        self.power_off = device.board.power_off

    def device_descriptor(self) -> bytes:
        own = self.device.descriptors
        ids = (own.vendor, own.product, own.release, 1, 2, 3, 1)
        return struct.pack("<BBHBBBBHHHBBBB", 18, DEVICE, 0x0200, own.device_class, 0, 0, 64, *ids)

    def configuration_descriptor(self) -> bytes:
        ends = b"".join(struct.pack("<BBBBHB", 7, 5, at, 2, size, 0) for at, size in self.endpoints.items())
        interface = bytes((9, 4, 0, 0, len(self.endpoints), 0xFF, 0xFF, 0xFF, 2))
        head = struct.pack("<BBHBBBBB", 9, CONFIGURATION, 18 + len(ends), 1, 1, 0, 0xC0, 50)
        return head + interface + ends

    def control(self, kind: int, request: int, value: int, index: int) -> bytes | None:
        if (kind, request) != (STANDARD_IN, GET_DESCRIPTOR):
            return self.device.request(kind, request, value, index)
        sort, number = value >> 8, value & 0xFF
        if sort == DEVICE:
            return self.device_descriptor()
        if sort == CONFIGURATION and number == 0:
            return self.configuration_descriptor()
        if sort == STRING and number == 0:
            return bytes((4, STRING, 0x09, 0x04))  # language: English (United States)
        if sort == STRING and number <= len(self.strings):
            text = self.strings[number - 1].encode("utf-16-le")
            return bytes((2 + len(text), STRING)) + text
        return None

    def read(self) -> bytes:
        """Bulk IN: what is there now."""
        packet = self.device.packet_in()
        return packet[1] if packet else b""

    def report(self) -> tuple[dict[str, object], dict[str, np.ndarray]]:
        """Counts of the board, and what it played."""
        names = ("frames_played", "underruns", "bytes_received", "emitting", "divider", "starved_ns", "bytes_skipped")
        facts = {name: getattr(self.board, name) for name in names if hasattr(self.board, name)}
        arrays = {
            name: getattr(self.board, name)
            for name in ("played", "played_ns", "lateness_ns", "playing")
            if hasattr(self.board, name)
        }
        return facts, arrays


def _emulator(serial: str, clock, record: int) -> Chip:
    return Chip(EmulatorUsb(serial, Board(clock, record=record)), step_bytes=16384)


def _pat16(serial: str, clock, record: int) -> Chip:
    board = PatBoard(clock, record=record, chip_bytes=FT232H_CHIP_BYTES, on_for_ns=ON_FOR_NS)
    return Chip(Ft232h(clock, serial, board), step_bytes=2048)


CHIPS = {"emulator": _emulator, "pat16": _pat16}
