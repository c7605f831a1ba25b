"""What a bridge hands to its library, one device sample after the other: slow, and read from the specification alone.

docs/formats/ultraleap-bridge.md, section "Time": a device sample that is due at d takes sample k while
k / rate <= d + half a device sample < (k + 1) / rate, counted from the device sample that took sample 0.
"""

from dataclasses import dataclass, field

HOLD_NS = 100_000_000
DEVICE_NS = 25_000  # of one focal point: 40 kHz; of n it is modelled as n times as long


@dataclass
class Handed:
    """What was handed over."""

    begun: list[tuple[int, int]] = field(default_factory=list)
    """Samples in the order in which they were handed over: place among all that were sent, and when [ns]."""
    sounding: list[bool] = field(default_factory=list)
    """Of each device sample, whether its intensity is above 0."""
    dropped: int = 0
    dry: int = 0
    dry_samples: int = 0


def handed_over(events, *, divider, points, end_ns):
    """Play events after an `OPEN` of the rate 40 kHz / divider at time 0 until `end_ns`; all times in [ns].

    events: (time, intensities of samples that come then), or None in place of these for a `STOP`; rising times,
    none of them that of a device sample.
    """
    device, period = points * DEVICE_NS, divider * DEVICE_NS
    out, waiting, intensity, sample_count = Handed(), [], 0.0, 0
    origin = None  # when sample 0 of the current run began; None: the next sample begins a new run
    run_count = 0  # samples of the run that have begun
    dry_since, is_counted = None, False
    pending = list(events)
    number = 0
    while (due := number * device) <= end_ns:
        number += 1
        while pending and pending[0][0] <= due:
            _, levels = pending.pop(0)
            if levels is None:
                out.dropped, waiting, intensity = out.dropped + len(waiting), [], 0.0
                is_counted = False
            else:
                waiting += [(sample_count + n, level) for n, level in enumerate(levels)]
                sample_count += len(levels)
        is_due = origin is not None and due + device // 2 >= origin + run_count * period
        if is_due and not waiting:
            origin, dry_since = None, due
            is_counted = intensity > 0  # after a silent sample it is a pause that was meant
            out.dry += is_counted
        if waiting and (is_due or origin is None):
            if origin is None:
                origin, run_count, dry_since = due, 0, None
            name, intensity = waiting.pop(0)
            out.begun.append((name, due))
            run_count += 1
            is_counted = False
        out.dry_samples += is_counted
        if dry_since is not None and due - dry_since >= HOLD_NS:
            intensity = 0.0
        out.sounding.append(intensity > 0)
    return out
