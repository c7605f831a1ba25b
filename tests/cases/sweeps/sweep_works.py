"""What workers of test_sweep_engines.py do, by a task's name: workers import it, as they import the real thing."""

import os
import signal
import sys
import time
import warnings
from pathlib import Path

import warp as wp

from palpate.render.errors import PalpateWarning, StrategyError
from palpate.render.sweeps.make.task import Outcome


def do(task, device, *, worker, progress):
    """Do what the task's name says; `said` in its store has a line for each that was begun: number, pid."""
    with (Path(task.store) / "said").open("a") as file:
        file.write(f"{task.number} {os.getpid()}\n")
    verb, _, argument = task.name.partition(" ")
    progress((0,))
    return ACTS[verb](task, device, worker, argument)


@wp.kernel
def poke(place: wp.array(dtype=wp.int32)):
    place[0] = 1


def done(task, device, worker, argument=""):
    return Outcome(task.number, worker, shard=f"{task.number}.shard", row_count=len(task.chunks), pose_count=7)


def rest(task, device, worker, seconds):
    time.sleep(float(seconds))
    return done(task, device, worker)


def count(task, device, worker, seconds):
    """Be busy without ever sleeping."""
    until = time.monotonic() + float(seconds)
    while time.monotonic() < until:
        pass
    return done(task, device, worker)


def die(task, device, worker, argument):
    os.kill(os.getpid(), getattr(signal, argument))


def die_after(task, device, worker, seconds):
    """Come back, and die with whatever this worker does next."""
    signal.signal(signal.SIGALRM, lambda *_: os.kill(os.getpid(), signal.SIGKILL))
    signal.setitimer(signal.ITIMER_REAL, float(seconds))
    return done(task, device, worker)


def leave(task, device, worker, code):
    sys.stderr.write("noise\nthe reason\n")
    sys.stderr.flush()
    os._exit(int(code))


def leave_child(task, device, worker, seconds):
    """End this process, but leave a child that has all of its files open."""
    if os.fork() == 0:
        time.sleep(float(seconds))
        os._exit(0)
    os._exit(3)


class OwnError(BaseException):
    def __str__(self):
        raise ValueError("no words")


def raise_strange(task, device, worker, kind):
    raise {"own": OwnError, "interrupt": KeyboardInterrupt, "bytes": ValueError}[kind]("bad \udcff name" + "x" * 10**6)


def call_exit(task, device, worker, code):
    sys.exit(int(code))


def refuse(task, device, worker, argument):
    raise StrategyError("this cannot be made") if argument == "told" else ZeroDivisionError(argument)


def warn(task, device, worker, text):
    warnings.warn(text, PalpateWarning, stacklevel=1)
    return done(task, device, worker)


def talk(task, device, worker, argument):
    print("x" * int(argument))  # noqa: T201 - a user's function may, and results must stay clean of it
    return done(task, device, worker)


def tell(task, device, worker, argument):
    """What a worker is: in the shard's place."""
    told = f"{os.environ['OMP_NUM_THREADS']} {wp.get_device()} {signal.getsignal(signal.SIGINT) == signal.SIG_IGN}"
    return Outcome(task.number, worker, shard=told)


def fault(task, device, worker, argument):
    """Write where there is no memory, as a kernel of a user's could; after this its process cannot use the GPU."""
    nowhere = wp.array(ptr=16, dtype=wp.int32, shape=1, device=device)
    wp.launch(poke, dim=1, outputs=[nowhere], device=device)
    wp.zeros(1, dtype=wp.int32, device=device).numpy()
    return done(task, device, worker)


ACTS = {
    "done": done,
    "rest": rest,
    "count": count,
    "die": die,
    "die-after": die_after,
    "leave": leave,
    "leave-child": leave_child,
    "raise-strange": raise_strange,
    "exit": call_exit,
    "refuse": refuse,
    "warn": warn,
    "talk": talk,
    "tell": tell,
    "fault": fault,
}
