"""Stand-ins for trackers: hands as they would send them, late, lost, out of order, wrong; and their services."""

import json
import threading
import time
from contextlib import contextmanager

import numpy as np

from palpate.datasets.hand_model.joints import DIGITS, Joint
from palpate.datasets.recordings.sample import sample_recording
from palpate.datasets.rigid import matrix_of
from palpate.render.live.sources.hand_frame import SeenHand

DOWN = (0.5**0.5, 0.0, 0.0, 0.5**0.5)
LEAPJS_ENDS = ("carpPosition", "mcpPosition", "pipPosition", "dipPosition", "tipPosition")


def palm_at(time_s, x=0.0):
    """Pose of a palm that circles 200 mm above an array, shape [7]."""
    return np.array([x + 0.03 * np.cos(time_s), 0.03 * np.sin(time_s), 0.2, *DOWN])


def palm_frames(rate, seconds, *, start=500.0, side="right", hand_id="1", x=0.0):
    """Frames of a palm at a rate [Hz], on a clock that reads `start` [s] at first."""
    times = np.arange(round(rate * seconds)) / rate
    return [SeenHand(start + t, side, hand_id, palm_at(t, x)) for t in times.tolist()]


def joint_frames(rate, seconds, *, start=500.0, is_left=False):
    """Frames with the joints of a hand that circles and bends, in a tracker's frame whose y is up."""
    made = sample_recording(frame_count=round(rate * seconds), rate=rate, is_left=is_left)
    side = "left" if is_left else "right"
    times = (start + made.time).tolist()
    return [
        SeenHand(at, side, "1", None, pose, made.joint_radius) for at, pose in zip(times, made.joint_pose, strict=True)
    ]


def datagram_of(frame):
    """A frame as docs/formats/live-poses.md describes it."""
    palm = None if frame.pose is None else frame.pose.tolist()
    return json.dumps({"time": frame.time, "side": frame.side, "id": frame.hand_id, "palm": palm}).encode()


def arrivals(frames, rng, *, delay=2e-3, jitter=0.0, loss=0.0, swaps=0.0, offset=-300.0, drift=0.0):
    """(arrival [ns], frame) in order of arrival.

    A frame comes `delay` plus an exponential `jitter` [s] after it was seen; a share `loss` never; a share `swaps` so
    late that the next ones come first. The host's clock reads the source's plus `offset` [s], which grows by `drift`.
    """
    found = []
    first = frames[0].time
    for frame in frames:
        if rng.random() < loss:
            continue
        seen = frame.time + offset + drift * (frame.time - first)
        late = delay + rng.exponential(jitter) if jitter else delay
        late += 0.05 if rng.random() < swaps else 0.0
        found.append((round((seen + late) * 1e9), frame))
    return sorted(found, key=lambda one: one[0])


def seen_at(frame, first, *, offset=-300.0, drift=0.0):
    """When a frame of `arrivals` was seen, on the host's clock [s]."""
    return frame.time + offset + drift * (frame.time - first)


def leapjs_frame(recording, number, *, hand_id=7, restored=True):
    """A frame of LeapJS protocol 6 as a tracking service sends it, as text.

    restored: as UltraleapTrackingWebSocket: bones' widths are summed wrongly and are a third of a finger's, `length` is
    a width.
    """
    pose, radius = recording.joint_pose[number], recording.joint_radius
    axes = matrix_of(pose[Joint.PALM, 3:])
    side = "left" if recording.is_left else "right"
    pointables = []
    for digit, chain in enumerate(DIGITS):
        joints = chain if digit else (chain[0], *chain)  # a thumb's metacarpal has no length
        width = 2e3 * float(radius[chain[-1]])
        finger = {"handId": hand_id, "id": hand_id * 10 + digit, "type": digit, "extended": True, "tool": False}
        finger |= {key: (pose[k, :3] * 1e3).tolist() for key, k in zip(LEAPJS_ENDS, joints, strict=True)}
        bases = [matrix_of(pose[k, 3:]).T for k in joints[:-1]]
        if recording.is_left:  # Leap reverses X of left hands
            bases = [basis * [[-1.0], [1.0], [1.0]] for basis in bases]
        finger["bases"] = [basis.tolist() for basis in bases]
        finger["width"] = width * 3.25 / 10 if restored else width
        finger["length"] = width if restored else 60.0
        pointables.append(finger)
    palm = pose[Joint.MIDDLE_PROXIMAL, :3] + 0.02 * axes[:, 2]
    hand = {
        "id": hand_id,
        "type": side,
        "palmPosition": (palm * 1e3).tolist(),
        "palmNormal": (-axes[:, 1]).tolist(),
        "direction": (-axes[:, 2]).tolist(),
        "palmWidth": recording.breadth * 1e3,
        "wrist": (pose[Joint.WRIST, :3] * 1e3).tolist(),
        "confidence": 1.0,
    }
    stamp = round((recording.offset + recording.time[number]) * 1e6)
    head = {"currentFrameRate": 110.0, "id": number, "timestamp": stamp, "devices": []}
    return json.dumps({**head, "hands": [hand], "pointables": pointables})


def empty_leapjs_frame(stamp_us):
    return json.dumps({"currentFrameRate": 110.0, "id": 1, "timestamp": stamp_us, "hands": [], "pointables": []})


@contextmanager
def tracking_service(messages, *, version=6, path="/v6.json", connections=1):
    """A WebSocket service that speaks LeapJS's protocol; gives its URL and the list of what clients have sent.

    messages: texts that each connection gets once the client has asked for them; then the connection is closed.
    """
    from websockets.sync.server import serve

    wishes = []

    def handle(connection):
        if connection.request.path != path:
            connection.close()
            return
        connection.send(json.dumps({"version": version}))
        state = {"attached": True, "id": 1, "streaming": True, "type": "peripheral"}
        connection.send(json.dumps({"event": {"type": "deviceEvent", "state": state}}))
        while '{"background":true}' not in wishes:
            wishes.append(connection.recv(timeout=5))
        for text in messages:
            connection.send(text)
            time.sleep(0.002)  # one by one: of several that wait, the newest alone is read

    with serve(handle, "127.0.0.1", 0, compression=None) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}{path}", wishes
        server.shutdown()
        thread.join()


class ListedSource:
    """A source of a program's own: gives what it was made of, then ends or fails."""

    clock = "own"

    def __init__(self, seen, *, error="", pause=0.0):
        self.seen, self.error, self.pause = seen, error, pause
        self.is_open = False

    def __enter__(self):
        self.is_open = True
        return self

    def __exit__(self, *error):
        self.is_open = False

    def __iter__(self):
        for one in self.seen:
            time.sleep(self.pause)
            yield one
        if self.error:
            raise ConnectionError(self.error)


def two_palms():
    """What a user names as MODULE:NAME."""
    return ListedSource(palm_frames(90.0, 2 / 90))


def no_source():
    return 3
