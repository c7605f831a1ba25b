"""Waiting until an array is silent."""

from __future__ import annotations

from .errors import DeviceLostError, LinkError
from .link import Link

OFF_ATTEMPTS = 3  # a stall on the off frame is passing, or it is not
DRAIN_MARGIN_NS = 500_000_000  # beyond the playing time of what is queued, before the array counts as hung


def is_switched_off(link: Link) -> bool:
    """Send the off frames, again if that fails; False if the array did not take them in three attempts, or is gone."""
    for _ in range(OFF_ATTEMPTS):
        try:
            link.send_off()
        except DeviceLostError:
            return False
        except LinkError:
            continue
        return True
    return False


def wait_silent(link: Link, divider: int) -> bool | None:
    """Wait until the board has played what is queued, the off frames at its end, and says that it is silent.

    Returns False if it does not come to that in time; None if the board never answers, or cannot say that it is silent:
    then this has waited for as long as its FIFO can take, or until nothing was queued.
    """
    clock, period_ns = link.clock, round(1e9 / link.array.update_rate(divider))
    status = link.status()
    if status is None:
        clock.sleep_until_ns(clock.now_ns() + (link.array.fifo_frames + link.off_frames) * period_ns)
        return None
    deadline_ns = clock.now_ns() + (status.fifo_frames + link.off_frames) * period_ns + DRAIN_MARGIN_NS
    while status is not None and (status.level or status.fifo_frames):
        now_ns = clock.now_ns()
        if now_ns > deadline_ns:
            return False
        clock.sleep_until_ns(now_ns + period_ns)
        status = link.status()
    return None if status is None or status.level is None else True
