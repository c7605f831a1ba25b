"""Emulated bridges in this process, each with the model of an array behind it."""

from __future__ import annotations

from collections.abc import Sequence

from ...clock import Clock, MonotonicClock
from ...errors import DeviceBusyError, DeviceLostError, DeviceNotFoundError
from .model import BridgeModel


class EmulatedBridge:
    """Bridges, each with an array: give them to `open_link` as the backend.

    Args:
        serials: identifier of each array.
        clock: clock of all; None takes the monotonic one.
        record: how many of its last samples each keeps.

    >>> from palpate.device import VirtualClock, array_model, emulated_backend, open_link
    >>> bridge = emulated_backend("stratos", clock=VirtualClock())
    >>> with open_link(array_model("stratos"), backend=bridge) as link:
    ...     link
    BridgeLink('stratos', serial='USX:EMULATED')
    """

    def __init__(
        self, serials: Sequence[str] = ("USX:EMULATED",), *, clock: Clock | None = None, record: int = 0
    ) -> None:
        self.clock: Clock = clock or MonotonicClock()
        self._record = record
        self._serials = tuple(serials)
        self._boards: list[BridgeModel | None] = [self._switched_on(serial) for serial in self._serials]
        self._channels: dict[int, _ModelChannel] = {}

    def board(self, *, index: int = 0) -> BridgeModel:
        """The model of a bridge; raises DeviceNotFoundError for one that is unplugged."""
        board = self._boards[index]
        if board is None:
            raise DeviceNotFoundError(f"array {self._serials[index]} is unplugged")
        return board

    def connect(self, serial: str | None) -> _ModelChannel:
        """A connection to the bridge of an array, or the first one's.

        Raises:
            DeviceNotFoundError: no bridge has that array, or it is unplugged.
            DeviceBusyError: it has another client.
        """
        if serial is not None and serial not in self._serials:
            raise DeviceNotFoundError(f"no emulated bridge has the array {serial!r}; known: {', '.join(self._serials)}")
        index = 0 if serial is None else self._serials.index(serial)
        board = self.board(index=index)
        before = self._channels.get(index)
        if before is not None and before.is_open:
            raise DeviceBusyError(f"array {self._serials[index]} is in use: stop the other player")
        channel = self._channels[index] = _ModelChannel(board)
        return channel

    def unplug(self, *, index: int = 0) -> None:
        """End a bridge: its array is silent, and its connection ends."""
        self._boards[index] = None
        if index in self._channels:
            self._channels[index].close()

    def replug(self, *, index: int = 0) -> None:
        """Start it again."""
        self._boards[index] = self._switched_on(self._serials[index])

    def _switched_on(self, serial: str) -> BridgeModel:
        return BridgeModel(self.clock, serial, record=self._record)


class _ModelChannel:
    """A connection to a model: its answers are there at once."""

    name = "emulated"

    def __init__(self, board: BridgeModel) -> None:
        self.where = f"emulated {board.identifier}"
        self.is_open = True
        self._board = board
        self._answers = b""

    def send(self, data: bytes) -> None:
        """Hand over all of the bytes."""
        if not self.is_open:
            raise self._lost()
        answers, stays = self._board.receive(data)
        self._answers += answers
        if not stays:
            self.close()

    def receive(self, timeout: float) -> bytes:
        """What the model has answered; b"" if nothing, since nothing comes later."""
        if not self._answers and not self.is_open:
            raise self._lost()
        answers, self._answers = self._answers, b""
        return answers

    def close(self) -> None:
        """End the connection."""
        if self.is_open:
            self.is_open = False
            self._board.leave()

    def _lost(self) -> DeviceLostError:
        return DeviceLostError(f"the bridge of {self.where} is gone")
