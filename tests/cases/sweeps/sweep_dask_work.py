"""Stand-ins for what makes a task: importable by workers, told what to do by the task's pieces."""

import os
import signal
import sys
import threading
import time
from pathlib import Path

from palpate.render.sweeps.make.task import Chunk, Outcome, Task
from palpate.render.sweeps.run import dask_worker as dask_worker_module


def make_task(number, *words, store, name=None):
    """A task whose pieces are words that `work` understands."""
    return Task(number, tuple(Chunk(word, ("contours",)) for word in words), str(store), name or f"shard-{number}")


def work(task, device, *, worker, progress):
    """Do what each word says, then leave a shard with the words in it."""
    store = Path(task.store)
    progress((0,))
    for chunk in task.chunks:
        verb, _, value = chunk.recipe.partition(" ")
        VERBS[verb](store, value)
    shard = store / "shards" / task.name
    part = shard.with_name(f"{task.name}.{os.getpid()}.{threading.get_ident()}.tmp")
    part.write_text(" ".join(chunk.recipe for chunk in task.chunks))
    part.rename(shard)
    return Outcome(task.number, worker, f"shards/{task.name}", len(task.chunks), 512, 0.0)


def die(store, value):
    """As if out of memory."""
    time.sleep(0.2)
    os.kill(os.getpid(), signal.SIGKILL)


def die_once(store, value):
    """Only whoever comes first."""
    try:
        (store / value).touch(exist_ok=False)
    except FileExistsError:
        return
    die(store, value)


def fill_disk(store, value):
    """What a full disk raises."""
    raise OSError(28, "No space left on device", str(store / value))


def spoil(store, value):
    """As a fault in a kernel does: the task fails, and the GPU takes no other."""
    dask_worker_module.is_usable = lambda device: False
    raise ValueError(value)


VERBS = {
    "text": lambda store, value: None,
    "sleep": lambda store, value: time.sleep(float(value)),
    "write": lambda store, value: (store / value).write_text(str(os.getpid())),
    "die": die,
    "die-once": die_once,
    "spoil": spoil,
    "disk": fill_disk,
    "raise": lambda store, value: (_ for _ in ()).throw(ValueError(value)),
    "exit": lambda store, value: sys.exit(int(value)),
}
