"""Time from explorations to wire bytes of a pat16: poses, contours, focal points and frames, all on one device.

    python benchmarks/wire_bytes.py --motions 4 --at-once 2
    python benchmarks/wire_bytes.py --device cuda:0 --motions 1000 --at-once 100

Motions last 30 s at 90 Hz; focal points come at 10 kHz. Frames have 512 bytes, which are dropped after a checksum. One
line of JSON, with the seconds of each part, which is waited for; the first group is made once before, which compiles.
It also runs small as a test (tests/house/test_benchmarks.py).
"""

import argparse
import json
from collections.abc import Callable
from time import perf_counter
from typing import Any

import warp as wp
from batch_sampling import POSES, contours_of, sample

from palpate.render.playback.device_frames import PulsePacker
from palpate.render.sampling.presets import load_sampling

FRAMES_AT_ONCE = 1 << 22  # packed before they are dropped: 2 GB


@wp.kernel
def _add_words(
    # In:
    words: wp.array[wp.uint64],
    stride: int,
    # Out:
    total: wp.array[wp.uint64],
):
    """Sum of all words modulo 2^64, in any order."""
    i = wp.tid()
    sum = wp.uint64(0)
    for k in range(i, words.shape[0], stride):
        sum += words[k]
    wp.atomic_add(total, 0, sum)


def add_frames(frame: wp.array, total: wp.array) -> None:
    """Add the 64-bit words of frames to a checksum on their device."""
    count = frame.size // 8
    words = wp.array(ptr=frame.ptr, shape=count, dtype=wp.uint64, device=frame.device, copy=False)
    stride = min(count, 1 << 16)
    if stride:
        wp.launch(_add_words, stride, inputs=[words, stride], outputs=[total], device=frame.device)


def measure(device: str, motions: int, at_once: int, sampling: str = "stm") -> dict[str, Any]:
    """Figures of so many motions."""
    strategy, packer = load_sampling(sampling), PulsePacker("pat16", device=device)
    total = wp.zeros(1, dtype=wp.uint64, device=device)
    seconds = {"poses and contours": 0.0, "focal points": 0.0, "frames": 0.0}
    counts = {"frames": 0, "refused": 0}

    def timed(name: str, make: Callable[[], Any]) -> Any:
        started = perf_counter()
        made = make()
        wp.synchronize_device(device)
        seconds[name] += perf_counter() - started
        return made

    def pack(samples: Any) -> None:
        points, levels = samples.position.flatten(), samples.intensity.flatten()
        for first in range(0, points.shape[0], FRAMES_AT_ONCE):
            part = slice(first, min(first + FRAMES_AT_ONCE, points.shape[0]))
            packed = packer.pack(points[part], levels[part])
            counts["refused"] += packed.refused
            add_frames(packed.frame, total)
        counts["frames"] += points.shape[0]

    def run(first: int) -> None:
        stop = min(first + at_once, motions)
        batch, pose = timed("poses and contours", lambda: contours_of(first, stop, device))
        pack_of = timed("focal points", lambda: sample(batch, pose, strategy, device))
        timed("frames", lambda: pack(pack_of))

    run(0)
    total.zero_()
    seconds.update(dict.fromkeys(seconds, 0.0))
    counts.update(dict.fromkeys(counts, 0))
    for first in range(0, motions, at_once):
        run(first)
    whole = sum(seconds.values())
    figures = {"device": device, "motions": motions, "poses": motions * POSES, **counts, "seconds": whole}
    return {**figures, **{f"seconds of {name}": value for name, value in seconds.items()}, "sum": int(total.numpy()[0])}


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--motions", type=int, default=4)
    parser.add_argument("--at-once", type=int, default=100)
    given = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    print(json.dumps(measure(given.device, given.motions, given.at_once)))


if __name__ == "__main__":
    main()
