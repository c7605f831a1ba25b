"""A live hand from an Ultraleap tracker, by the WebSocket of its tracking service (LeapJS protocol, versions 6 and 7).

`ws://localhost:6437/v6.json` is served by UltraleapTrackingWebSocket beside a current service, and up to Orion 4 by the
service itself, which serves v7.json, too. Frames are those of LeapJS recordings: `datasets/recordings/leapjs.py` reads
them. UltraleapTrackingWebSocket sends wrong widths of fingers, too small for any finger, which are left out there.
"""

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self
from urllib.parse import urlsplit

import numpy as np

from ....datasets.errors import RecordingError
from ....datasets.json_text import parse_json
from ....datasets.recordings.clip import Sighting
from ....datasets.recordings.leapjs import frame_hands
from ...errors import StrategyError
from .hand_frame import OWN, Seen, SeenHand, SourceFault

URL = "ws://localhost:6437/v6.json"
VERSIONS = (6, 7)
"""Of the protocol: in what is read here they are alike."""
WISHES = ({"background": True}, {"focused": True}, {"optimizeHMD": False})
"""Sent when the socket opens: frames come also while another program has the focus; the tracker lies on a table."""
RECONNECT_DELAY = 1.0  # [s]
_OPEN_TIMEOUT = 5.0  # [s]
_LINE_UP_MOST = 64  # frames that wait; only the newest one is read


@dataclass(frozen=True)
class UltraleapSource:
    """Hands of an Ultraleap tracker as its service sends them, in the tracker's frame; it connects again when cut off.

    The tracker's frame is Leap's: x to the right along the device, y up out of it, z to the user; so `y-up` aligns a
    tracker that lies at the array's centre.
    """

    url: str = URL
    clock: str = OWN

    @classmethod
    def at(cls, url: str) -> Self:
        """The source at a URL, or, for an empty text, the default; raises StrategyError."""
        parts = urlsplit(url or URL)
        if parts.scheme != "ws" or not parts.hostname:
            raise StrategyError(f"the URL of a tracking service must be like {URL}, not {url!r:.80}")
        return cls(url or URL)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """The connection is closed where it is read."""

    def __iter__(self) -> Iterator[Seen]:
        """Hands and faults as they come, for ever."""
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect

        last = None
        while True:
            try:
                with connect(
                    self.url, open_timeout=_OPEN_TIMEOUT, close_timeout=0.1, compression=None, proxy=None
                ) as connection:
                    for wish in WISHES:
                        connection.send(json.dumps(wish, separators=(",", ":")))  # the server compares it byte by byte
                    while True:
                        seen = seen_in(_newest(connection))
                        if isinstance(seen, list):
                            last = seen[0].time
                        if seen is not None:
                            yield seen
            except (OSError, WebSocketException) as error:
                why = getattr(error, "strerror", None) or str(error) or type(error).__name__
                if last is not None:
                    yield SeenHand(last + 1e-6)  # no hand is seen any more
                    last = None
                text = f"no connection to the tracking service at {self.url}: {why}; it is tried again"
                yield SourceFault("connection", text)
            time.sleep(RECONNECT_DELAY)


def _newest(connection: Any) -> str | bytes:
    """Wait for a message; of several that wait, the newest frame, or the first that is none."""
    from websockets.exceptions import ConnectionClosed

    data = connection.recv()
    for _ in range(_LINE_UP_MOST):
        if not (isinstance(data, str) and '"timestamp"' in data):  # no frame: it is reported
            break
        try:
            data = connection.recv(timeout=0)
        except (TimeoutError, ConnectionClosed):  # the next call raises the latter again
            break
    return data


def seen_in(data: str | bytes) -> list[SeenHand] | SourceFault | None:
    """All hands of a message, or a frame without any; a fault; None for what need not be reported."""
    try:
        content = parse_json(data, allow_nan=True)
    except ValueError as error:
        return SourceFault("message", f"a message of the tracking service is no JSON: {error}")
    if not isinstance(content, dict):
        return SourceFault("message", f"a message of the tracking service must be an object, not {content!r:.60}")
    if "timestamp" not in content:
        return _notice(content)
    try:
        frame_id = content.get("id", 0)
        found = frame_hands(content, frame_id if isinstance(frame_id, int) else 0)
    except RecordingError as error:
        return SourceFault("frame", str(error))
    if found is None:
        return None
    return [_hand(found[0], one) for one in found[1]] or [SeenHand(found[0])]


def _notice(content: dict[str, Any]) -> SourceFault | None:
    """What the service says about itself and its devices, if something is wrong with it."""
    version = content.get("version")
    if version is not None and version not in VERSIONS:
        known = " and ".join(map(str, VERSIONS))
        return SourceFault("version", f"version: the tracking service speaks {version!r:.20}; {known} are understood")
    event = content.get("event")
    state = event.get("state") if isinstance(event, dict) else None
    if isinstance(state, dict) and not (state.get("attached", True) and state.get("streaming", True)):
        what = "is not attached" if not state.get("attached", True) else "does not stream"
        return SourceFault("device", f"device: the tracker {what}, as its service says")
    return None


def _hand(at: float, one: Sighting) -> SeenHand:
    joints = np.concatenate([one.position, one.quaternion], axis=1)
    return SeenHand(at, one.side, one.hand_id, None, joints, one.radius)
