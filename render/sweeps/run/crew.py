"""The workers of a cluster: who is there, whether each is fit for the sweep, and the end of one that hangs."""

from __future__ import annotations

import contextlib
import pickle
import threading
import time
import uuid
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

from ...errors import PalpateWarning, SweepError
from ..plan.code_version import code_version
from .cluster import Connection
from .dask_worker import Fitness, Terms, end_process, kill_worker, travelling

SIGHT = 5.0  # [s] until a file that a worker has written must be seen here: network file systems remember
REPLACED = 60.0  # [s] that a fit worker may be missed while unfit ones are there: what died is replaced within that
NOBODY = "tcp://127.0.0.1:1"  # an address without a worker: tasks wait there until `_look_after` sends them again


class Crew:
    """Workers of a connection, as far as is known; the scheduler's events keep it true, without asking.

    store: folder of the store, which every worker must find at the same path. run: names our events and our token.
    """

    def __init__(self, connection: Connection, store: Path, run: str) -> None:
        self._connection = connection
        self._token = store / f".workers-{run}"
        self.terms = Terms(run, code_version(), connection.device, str(self._token))
        self._threads: dict[str, int] = {}
        self._fitness: dict[str, Fitness] = {}
        self._is_stale = True
        self._there_at = self._fit_at = time.monotonic()

    @property
    def client(self) -> Any:
        """Dask's."""
        return self._connection.client

    def gather(self) -> None:
        """Wait for the workers, and see that each can do the work.

        Raises SweepError if they do not come within the connection's patience, or naming those that cannot.
        """
        wanted, patience = self._connection.worker_count, self._connection.patience
        end = time.monotonic() + patience
        while len(self.threads()) < wanted:
            if time.monotonic() > end:
                there = f"{len(self._threads)} of {wanted} workers are"
                raise SweepError(f"only {there} there after {patience:g} s ({self._connection.name})")
            time.sleep(0.05)
            self._is_stale = True
        self.client.subscribe_topic("all", self._note)
        self._token.write_text(self.terms.run)
        self._judge()
        self._tell_shared_cards()

    def threads(self) -> dict[str, int]:
        """Tasks that each worker makes at a time, by its address."""
        if self._is_stale:
            self._is_stale = False  # before asking: what happens meanwhile is asked for again
            try:
                self._threads = dict(self.client.nthreads())
            except OSError as error:  # the client has tried to reach it for as long as it may
                raise self._gone() from error
        if self._threads:
            self._there_at = time.monotonic()
        return self._threads

    def devices(self) -> tuple[str, ...]:
        """Warp device of each thread of each worker; one that joined and made nothing yet will have the word's."""
        known = {address: fitness.device for address, fitness in self._fitness.items()}
        threads = self.threads().items()
        return tuple(known.get(address) or self._connection.device for address, count in threads for _ in range(count))

    def name(self, address: str) -> str:
        """A worker for people."""
        return self._fitness[address].name if address in self._fitness else address

    def fit(self) -> frozenset[str]:
        """Workers that tasks may go to; empty while every one is, so that those that join later are, too.

        While none is fit it is NOBODY: one that died may be replaced. Raises SweepError if that takes too long.
        """
        unfit = {address for address in self.threads() if self.is_unfit(address)}
        fit = frozenset(self._threads) - unfit
        if fit or not unfit:
            self._fit_at = time.monotonic()
            return fit if unfit else frozenset()
        if time.monotonic() - self._fit_at > min(REPLACED, self._connection.patience):
            raise SweepError(self._fitness[min(unfit)].complaint)
        return frozenset({NOBODY})

    def is_unfit(self, address: str) -> bool:
        """Whether a worker has shown that it cannot do the work."""
        return address in self._fitness and self._fitness[address].fault is not None

    def meet(self, fitness: Fitness) -> None:
        """Note what a worker that joined later has shown; an unfit one is told of, once."""
        is_news = fitness.fault is not None and not self.is_unfit(fitness.address)
        self._fitness[fitness.address] = fitness
        if is_news:
            warnings.warn(f"{fitness.complaint}; it is passed over", PalpateWarning, stacklevel=2)

    def look(self) -> None:
        """Raises SweepError if the scheduler, or all workers for longer than the connection's patience, are gone."""
        name, patience = self._connection.name, self._connection.patience
        if self.client.status == "closed":
            raise self._gone()
        if not self.threads() and time.monotonic() - self._there_at > patience:
            raise SweepError(f"no worker was there for {patience:g} s ({name}); what was finished is kept")

    def end(self, address: str) -> None:
        """End a worker's process, whatever it does, without waiting; a nanny starts another."""
        threading.Thread(target=self._end, args=(address,), daemon=True).start()

    def _end(self, address: str) -> None:
        """It may be gone already, by this or by itself."""
        with contextlib.suppress(Exception):
            has_nanny = self.client.scheduler_info()["workers"][address]["nanny"]
            end = kill_worker if has_nanny else end_process
            self.client.run(end, workers=[address], nanny=bool(has_nanny), on_error="ignore")
        self._is_stale = True

    def leave(self) -> None:
        """Take our files out of the store."""
        if self.client.status == "running":
            with contextlib.suppress(Exception):  # the scheduler may go at this very moment
                self.client.unsubscribe_topic("all")
        for path in self._token.parent.glob(f"{self._token.name}*"):
            path.unlink(missing_ok=True)

    def _gone(self) -> SweepError:
        """What ends the sweep without its scheduler."""
        return SweepError(f"the scheduler is gone ({self._connection.name}); what was finished is kept")

    def _note(self, event: tuple[float, Any]) -> None:
        """An event of the scheduler, on the client's loop, where nothing can be asked."""
        if isinstance(event[1], dict) and event[1].get("action") in ("add-worker", "remove-worker"):
            self._is_stale = True

    def _judge(self) -> None:
        """Have every worker show what it can; none may fail, as it was there when the sweep was begun."""
        _, judge = travelling()
        told = self.client.run(judge, pickle.dumps(self.terms), on_error="return")
        for address, answer in told.items():
            if isinstance(answer, BaseException):
                answer = (address, "a host that gave no answer", "", "", "", f"{type(answer).__name__}: {answer}")
            fitness = answer if isinstance(answer, Fitness) else Fitness(*answer)
            if fitness.fault is None and not self._is_seen(fitness.answer):
                fault = f"what it writes into {self._token.parent} is not seen here; the store must be a shared folder"
                fitness = Fitness(address, fitness.host, fitness.device, fault=fault)
            self._fitness[address] = fitness
        faults = sorted(f.complaint for f in self._fitness.values() if f.fault is not None)
        if faults:
            raise SweepError(faults[0] + (f" (and {len(faults) - 1} more workers)" if len(faults) > 1 else ""))

    def _is_seen(self, answer: str) -> bool:
        """Whether what a worker has written comes to be seen here."""
        path = self._token.with_name(answer)
        end = time.monotonic() + SIGHT
        while not path.exists():
            if time.monotonic() > end:
                return False
            time.sleep(0.1)
        return True

    def _tell_shared_cards(self) -> None:
        """Several workers on one GPU take turns, which nobody meant."""
        cards = Counter(fitness.card for fitness in self._fitness.values() if fitness.card)
        shared = [fitness for fitness in self._fitness.values() if cards.get(fitness.card, 0) > 1]
        if shared:
            names = " and ".join(sorted(fitness.name for fitness in shared if fitness.card == shared[0].card)[:2])
            told = f"{names} share one GPU; start each with a CUDA_VISIBLE_DEVICES of its own"
            warnings.warn(told, PalpateWarning, stacklevel=2)


def new_run() -> str:
    """A name that no other engine has."""
    return f"palpate-{uuid.uuid4().hex}"
