"""Time from explorations to wire bytes of a pat16: poses, contours, focal points and frames, all on one device.

    python benchmarks/wire_bytes.py --motions 4
    python benchmarks/wire_bytes.py --device cuda:0 --motions 1000

Motions last 30 s at 90 Hz; focal points come at 10 kHz. Frames have 512 bytes, which are dropped after a checksum. One
line of JSON, with the seconds of each part, which is waited for; one motion is made before, which compiles.
It also runs small as a test (tests/house/test_benchmarks.py).
"""

import argparse
import json
from collections.abc import Callable
from time import perf_counter
from typing import Any

import warp as wp

from palpate.render import Driver, ExploredPoses, render_motions
from palpate.render.motions.groups import MotionGroup


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


def measure(device: str, motions: int, memory: int | None = None, sampling: str = "stm") -> dict[str, Any]:
    """Figures of so many motions."""
    driver = Driver("pat16", device=device)
    seconds = {"poses and contours": 0.0, "focal points": 0.0, "frames": 0.0}
    counts = {"poses": 0, "frames": 0, "refused": 0, "groups": 0}
    total = wp.zeros(1, dtype=wp.uint64, device=device)

    def timed(name: str, make: Callable[[], Any]) -> Any:
        started = perf_counter()
        made = make()
        wp.synchronize_device(device)
        seconds[name] += perf_counter() - started
        return made

    def pack(group: MotionGroup) -> None:
        for packed in group.frames(driver):
            counts["refused"] += packed.refused
            counts["frames"] += len(packed.amplitude)
            add_frames(packed.frames[0], total)

    def run(count: int) -> None:
        trials = [ExploredPoses.of("tube", seed=k, explorer=1 + k % 100) for k in range(count)]
        groups = render_motions("tube", "palm", trials, "cc", sampling, device=device, memory=memory)
        while (group := timed("poses and contours", lambda: next(groups, None))) is not None:
            counts["groups"] += 1
            counts["poses"] += len(group.contours)
            timed("focal points", lambda group=group: group.samples)
            timed("frames", lambda group=group: pack(group))

    run(1)
    total.zero_()
    seconds.update(dict.fromkeys(seconds, 0.0))
    counts.update(dict.fromkeys(counts, 0))
    run(motions)
    whole = sum(seconds.values())
    figures = {"device": device, "motions": motions, **counts, "seconds": whole}
    return {**figures, **{f"seconds of {name}": value for name, value in seconds.items()}, "sum": int(total.numpy()[0])}


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--motions", type=int, default=4)
    parser.add_argument("--memory", type=int, help="of a group of motions [byte]")
    given = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    print(json.dumps(measure(given.device, given.motions, given.memory)))


if __name__ == "__main__":
    main()
