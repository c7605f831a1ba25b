"""Several arrays at once: the same moment's frames to each, and all off as soon as one fails."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from queue import Empty, Full, Queue
from threading import Thread

from ..errors import PlayInterrupted
from ..link import Link
from ..report import LiveStatistics, PlayReport
from .limits import Limits
from .player import Player, attach_report, tell_emission
from .signals import StopSignals

QUEUE_BLOCKS = 8
POLL = 0.02  # [s] between looks at what the others do

Watch = Callable[[LiveStatistics], object]


def play_together(
    links: Sequence[Link],
    blocks: Iterable[tuple[array[int], ...]],
    *,
    update_rate: float,
    limits: Limits | None = None,
    watch: Watch | None = None,
) -> list[PlayReport]:
    """Play to one array or to several, and return when all are off.

    Each array runs by its own clock and starts when it is ready: what several emit adds up at a focal point only where
    their boards share a carrier, which is a matter of wiring, not of this.

    Args:
        links: the opened arrays.
        blocks: wire bytes for each of them, of as many frames; taken on the calling thread.
        update_rate: frames a second [Hz], one that all of them have.
        limits: of on-time and duty, for each.
        watch: called on the calling thread, now and then, with the statistics of the first array so far.

    Returns:
        The statistics of each.

    Raises:
        PlayInterrupted, LinkError, SafetyLimitError, UpdateRateError, FrameError: as `Player.play`, of an array that
            failed; the others are off then, too. A `PlayInterrupted` carries the report of an array that may still be
            on, if there is one, and has its failure as its cause.
    """
    if len(links) == 1:
        return [Player(links[0], limits=limits).play((b[0] for b in blocks), update_rate=update_rate, watch=watch)]
    for link in links:
        link.array.divider(update_rate)
    group = _Group([_Seat(link, update_rate, limits) for link in links], watch)
    with StopSignals(group, enabled=True) as signals:
        try:
            group.start()
            for block in signals.iterate(blocks):
                if not group.put(block):
                    break
            group.end()
            group.join()
        except BaseException as error:
            group.request_stop("exception")
            group.join()
            reports = [seat.player.report for seat in group.seats if seat.player.report is not None]
            if reports:
                attach_report(error, next((report for report in reports if report.may_emit), reports[0]))
            raise
        finally:
            group.join()
    reports = [seat.player.report for seat in group.seats if seat.player.report is not None]
    if signals.signum is not None and reports:
        report = next((report for report in reports if report.may_emit), reports[0])
        interruption = PlayInterrupted(signals.signum, report)
        tell_emission(interruption, report)
        raise interruption from group.error
    if (error := group.error) is not None:
        raise error
    return reports


class _Seat:
    """The player of one array, on a thread of its own."""

    def __init__(self, link: Link, update_rate: float, limits: Limits | None) -> None:
        self.player = Player(link, limits=limits, handle_signals=False)
        self.queue: Queue[array[int] | None] = Queue(QUEUE_BLOCKS)
        self.error: BaseException | None = None
        self.live: LiveStatistics | None = None
        self.thread = Thread(target=self._run, name=f"palpate-player-{link.array.name}")
        self._update_rate = update_rate
        self._stopped = self._ended = False

    def stop(self, reason: str) -> None:
        """End its playback; safe in a signal handler."""
        self._stopped = True
        self.player.stop(reason)

    def put(self, block: array[int] | None) -> bool:
        """Queue a block, or None for the end; False if there was no room for a moment."""
        try:
            self.queue.put(block, timeout=POLL)
        except Full:
            return False
        self._ended = self._ended or block is None
        return True

    @property
    def has_failed(self) -> bool:
        """It plays no more, though its content has not ended."""
        return not self.thread.is_alive() and not self._ended

    def _run(self) -> None:
        try:
            self.player.play(self._blocks(), update_rate=self._update_rate, watch=self._look)
        except BaseException as error:  # the calling thread raises it
            self.error = error

    def _blocks(self) -> Iterator[array[int]]:
        while not self._stopped:
            try:
                block = self.queue.get(timeout=POLL)
            except Empty:
                continue
            if block is None:
                return
            yield block

    def _look(self, live: LiveStatistics) -> None:
        self.live = live


class _Group:
    """All of them; what a signal stops."""

    def __init__(self, seats: list[_Seat], watch: Watch | None) -> None:
        self.seats = seats
        self._watch = watch
        self._told: LiveStatistics | None = None

    @property
    def error(self) -> BaseException | None:
        """The first one's that failed."""
        return next((seat.error for seat in self.seats if seat.error is not None), None)

    def start(self) -> None:
        """Start the threads."""
        for seat in self.seats:
            seat.thread.start()

    def put(self, block: tuple[array[int], ...]) -> bool:
        """Queue a block for each; False if one has failed: then none is to go on."""
        for seat, part in zip(self.seats, block, strict=True):
            while not seat.put(part):
                self._tell()
                if any(other.has_failed for other in self.seats):
                    return False
        self._tell()
        return not any(seat.has_failed for seat in self.seats)

    def end(self) -> None:
        """Tell each that its content has ended; one that starts late plays all of its own, whoever is done by then."""
        for seat in self.seats:
            while seat.thread.is_alive() and not seat.put(None):
                if self.error is not None:
                    self.request_stop("device")

    def request_stop(self, reason: str) -> None:
        """Stop all."""
        for seat in self.seats:
            seat.stop(reason)

    def join(self) -> None:
        """Wait for all to end; if one fails, stop the others."""
        while any(seat.thread.is_alive() for seat in self.seats):
            if self.error is not None:
                self.request_stop("device")
            for seat in self.seats:
                if seat.thread.is_alive():
                    seat.thread.join(POLL)
            self._tell()

    def _tell(self) -> None:
        live = self.seats[0].live
        if self._watch is not None and live is not None and live is not self._told:
            self._told = live
            self._watch(live)
