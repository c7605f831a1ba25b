"""An FT232H's EEPROM: a pat16 is reached only through a chip that its EEPROM sets to 245 FIFO.

The lower four bits of byte 0 are 0 for a UART, 1 for FIFO, 2 opto, 4 CPU, 8 FT1248: so in libftdi (`CHANNEL_IS_UART`
and others, for TYPE_232H) and in pyftdi (`FtdiEeprom`). A chip without an EEPROM is a UART: so A. Gustschin's patch of
Linux's ftdi_sio, which reads the same word.
"""

from __future__ import annotations

import errno
from array import array

import numpy as np
import pytest
import usb.core
import usb.util
from injected_faults import Fault, FaultKind, inject

from palpate.device.boards.discovery import open_link
from palpate.device.boards.pat16.ftdi import FtdiPort
from palpate.device.boards.pat16.ftdi_model import EEPROM_BLANK, EEPROM_FIFO, Ft232h
from palpate.device.boards.pat16.model import PatBoard
from palpate.device.clock import VirtualClock
from palpate.device.codec import encode_frames
from palpate.device.emulation.usb_bus import EmulatedBus
from palpate.device.errors import DeviceLostError, LinkError
from palpate.device.registry import array_model, emulated_backend

READ_EEPROM = 0x90


def bus_with(eeprom: bytes) -> EmulatedBus[PatBoard]:
    bus = emulated_backend("pat16", clock=VirtualClock(), record=100)
    chip_of(bus).eeprom = eeprom
    return bus


def chip_of(bus: EmulatedBus[PatBoard]) -> Ft232h:
    chip = bus._devices[0]
    assert isinstance(chip, Ft232h)
    return chip


def test_the_model_s_eeprom_says_fifo_to_pyftdi() -> None:
    ftdi = pytest.importorskip("pyftdi.ftdi", reason="pyftdi is a test extra").Ftdi()
    eeprom = pytest.importorskip("pyftdi.eeprom").FtdiEeprom()
    device = usb.core.find(backend=bus_with(EEPROM_FIFO))
    ftdi._usb_dev = eeprom._ftdi._usb_dev = device
    eeprom._eeprom = bytearray(ftdi.read_eeprom(0, 256, 256))
    eeprom._decode_eeprom()
    said = {key: int(eeprom._config[key]) for key in ("vendor_id", "product_id", "type", "channel_a_type")}
    assert said == {"vendor_id": 0x0403, "product_id": 0x6014, "type": 0x0900, "channel_a_type": eeprom.CHANNEL.FIFO}
    usb.util.dispose_resources(device)


@pytest.mark.parametrize(
    ("eeprom", "cause"),
    [
        (EEPROM_BLANK, "is blank or missing, which makes it a UART"),
        (b"\x00" + EEPROM_FIFO[1:], "sets it to UART"),
        (b"\x10" + EEPROM_FIFO[1:], "sets it to UART"),  # bit 4: the system's serial driver is to be loaded
        (b"\x02" + EEPROM_FIFO[1:], "sets it to fast serial"),
        (b"\x04" + EEPROM_FIFO[1:], "sets it to CPU FIFO"),
        (b"\x08" + EEPROM_FIFO[1:], "sets it to FT1248"),
        (b"\x03" + EEPROM_FIFO[1:], "sets it to mode 3, which is none of its modes"),
    ],
)
def test_a_chip_in_another_mode_is_refused_with_what_to_do(eeprom: bytes, cause: str) -> None:
    bus = bus_with(eeprom)
    bus.bind_kernel_driver()
    with pytest.raises(LinkError, match=cause) as caught:
        open_link(array_model("pat16"), backend=bus)
    message = str(caught.value)
    assert message.startswith("array pat16 PATEMU01 cannot be reached: the EEPROM of its FT232H ")
    assert "hardware: 245 FIFO" in message
    assert "cha_type=FIFO" in message
    assert bus.board().bytes_received == 0
    assert bus._ports[0].driver  # given back


@pytest.mark.parametrize("first", [0x01, 0x11])
def test_a_chip_in_fifo_mode_is_played_to_whichever_driver_it_asks_for(first: int) -> None:
    bus = bus_with(bytes((first,)) + EEPROM_FIFO[1:])
    with open_link(array_model("pat16"), backend=bus) as link:
        link.start(4)
        link.write(array("B", encode_frames(np.zeros((3, 256)), np.ones(3), array=link.array).tobytes()))
        bus.clock.sleep_until_ns(bus.clock.now_ns() + 10_000_000)
        assert bus.board().emitting


def test_without_the_question_a_uart_would_take_everything_and_play_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FtdiPort, "require_fifo_mode", lambda _: None)
    bus = bus_with(EEPROM_BLANK)
    with open_link(array_model("pat16"), backend=bus) as link:
        link.start(4)
        frames = array("B", encode_frames(np.zeros((100, 256)), np.ones(100), array=link.array).tobytes())
        before = link.bytes_sent
        link.write(frames)
        assert link.bytes_sent == before + len(frames)
    assert (bus.board().bytes_received, bus.board().frames_played) == (0, 0)


@pytest.mark.parametrize("kind", [FaultKind.STALL, FaultKind.TIMEOUT, None])
def test_a_chip_that_does_not_give_its_eeprom_is_warned_of_and_played_to(kind: FaultKind | None) -> None:
    bus = bus_with(b"\x01" if kind is None else EEPROM_FIFO)  # half a word is no answer
    if kind is not None:
        inject(bus, Fault(kind, request=READ_EEPROM))
    with pytest.warns(RuntimeWarning, match="array pat16 PATEMU01 may be silent: its FT232H does not give its EEPROM"):
        open_link(array_model("pat16"), backend=bus).close()


def test_a_chip_that_vanishes_while_it_is_asked_is_lost() -> None:
    bus = bus_with(EEPROM_FIFO)
    inject(bus, Fault(FaultKind.UNPLUG, request=READ_EEPROM))
    with pytest.raises(DeviceLostError, match="pat16 PATEMU01 is gone") as caught:
        open_link(array_model("pat16"), backend=bus)
    assert isinstance(caught.value.__cause__, usb.core.USBError)
    assert caught.value.__cause__.errno == errno.ENODEV
