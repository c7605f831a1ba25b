"""The message in which a source sends a pose to the process that draws: one packet of a socket each.

Sender and receiver are processes of one palpate, so the layout is no public format.
"""

import os
import pickle
import socket
from dataclasses import dataclass, replace

import numpy as np

from ....datasets.rigid import Numbers

FAULT_BYTES = 1024  # of a fault's text at most
MESSAGE_BYTES = 65536  # of a message at most: 2,300 patches


@dataclass(frozen=True, eq=False)
class PoseMessage:
    """What a source reports: a pose, that there is no hand now, or a fault."""

    stamp_ns: int
    """When the hand was there, on this host's CLOCK_MONOTONIC [ns]."""
    source_time: float
    """The same on the source's own clock [s]."""
    pose: Numbers | None
    """Hand frame -> array frame: x y z [m] and quaternion xyzw, float64, shape [7]."""
    patch_pose: np.ndarray | None = None
    """Patch -> hand frame, float32, shape [patch, 7], NaN for a patch that is not there; None for a rigid hand."""
    skipped: int = 0
    """Frames that came since the message before and were not sent: late, too many, or not read in time."""
    fault: str = ""
    """What is wrong with the source or its frames, as one sentence; empty as a rule."""

    @property
    def is_lost(self) -> bool:
        """Whether the tracker sees no hand now. A fault without a pose says nothing about the hand: go on as before."""
        return self.pose is None and not self.fault

    def packed(self) -> bytes:
        """The message as bytes; a longer fault is cut to FAULT_BYTES."""
        fault = self.fault.encode("utf-8", errors="replace")[:FAULT_BYTES].decode("utf-8", errors="ignore")
        pose = None if self.pose is None else np.asarray(self.pose, np.float64).tobytes()
        patches = None if self.patch_pose is None else np.asarray(self.patch_pose, np.float32).tobytes()
        return pickle.dumps((self.stamp_ns, self.source_time, pose, patches, self.skipped, fault))

    @classmethod
    def unpacked(cls, data: bytes) -> "PoseMessage":
        """Read what `packed` gave; the arrays are read-only."""
        stamp_ns, source_time, pose, patches, skipped, fault = pickle.loads(data)  # of this program's own process
        return cls(
            stamp_ns,
            source_time,
            None if pose is None else np.frombuffer(pose),
            None if patches is None else np.frombuffer(patches, np.float32).reshape(-1, 7),
            skipped,
            fault,
        )


def message_pair() -> tuple[int, int]:
    """Descriptors of the receiver's and the sender's end: a socket pair that keeps messages apart, both non-blocking.

    SOCK_SEQPACKET rather than SOCK_DGRAM: its receiver notices at once that the sender has ended, however it ended.
    """
    pair = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in pair:
        end.setblocking(False)
    return pair[0].detach(), pair[1].detach()


class PoseSender:
    """The source's end: sends what fits, counts what does not."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=descriptor)
        self._socket.setblocking(False)
        self._skipped = 0
        self._fault = ""

    def send(self, message: PoseMessage) -> bool:
        """Send a message; False if the receiver has ended.

        While the receiver reads too slowly, messages are skipped; the next one carries their count and the first of
        their faults.
        """
        if self._skipped or self._fault:
            fault = self._fault or message.fault
            message = replace(message, skipped=message.skipped + self._skipped, fault=fault)
        try:
            self._socket.send(message.packed())
        except BlockingIOError:
            self._skipped, self._fault = message.skipped + (message.pose is not None), message.fault
            return True
        except OSError:  # the other end is closed
            return False
        self._skipped, self._fault = 0, ""
        return True

    def close(self) -> None:
        """Close the socket: the receiver sees the end of the messages."""
        self._socket.close()


def received_messages(descriptor: int) -> list[PoseMessage]:
    """All messages that wait at the receiver's end, the oldest first; empty if none do.

    Raises EOFError where the source has ended and all its messages have been read.
    """
    found: list[PoseMessage] = []
    while True:
        try:
            data = os.read(descriptor, MESSAGE_BYTES)
        except BlockingIOError:
            return found
        except ConnectionResetError:  # the sender ended without reading: nothing is ever sent to it
            data = b""
        if data:
            found.append(PoseMessage.unpacked(data))
        elif found:
            return found
        else:
            raise EOFError("the source of poses has ended")
