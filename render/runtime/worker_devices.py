"""Warp devices of workers, by the command line's words; Warp is imported only where a GPU may be meant."""

from __future__ import annotations

import ctypes
import os

from ..errors import StrategyError

WORKERS_MOST = 256  # on one device; a larger number is probably a typing error
GPU_WORKERS = 2  # one computes while the other downloads its results


def worker_devices(device: str, workers: int | None = None) -> list[str]:
    """Device of each worker, from the command line's options --device and --workers.

    device: "cpu", "cuda:0", several with commas between them, "cuda" (all GPUs), "auto" (the first GPU, else the CPU).
    workers: number on each device; None: one for each core of the CPU, two for a GPU.
    Raises StrategyError for a device that this machine lacks, one named twice, no workers, or more than WORKERS_MOST.

    >>> from palpate.render import worker_devices
    >>> worker_devices("cpu", workers=2)
    ['cpu', 'cpu']
    """
    if workers is not None and workers < 1:
        raise StrategyError(f"workers must be at least 1, not {workers}")
    if workers is not None and workers > WORKERS_MOST:
        raise StrategyError(f"workers must be at most {WORKERS_MOST} on each device, not {workers}")
    device = device.lower()
    if device == "cpu" or not has_cuda_driver():
        devices = [name.strip() for name in device.replace("auto", "cpu").split(",")]
        if other := next((name for name in devices if name != "cpu"), None):  # as `span_workers.warp_device` has it
            raise StrategyError(f"no device {other!r} on this machine; there is: cpu (GPUs are cuda:0, cuda:1, ...)")
    else:
        devices = _warp_devices(device)
    if len(set(devices)) < len(devices):
        raise StrategyError(f"device {device!r} names one device twice; workers=N puts N on each")
    cores = len(os.sched_getaffinity(0))
    count = {name: workers or (cores if name == "cpu" else GPU_WORKERS) for name in devices}
    return [name for name in devices for _ in range(count[name])]


def has_cuda_driver() -> bool:
    """Whether this machine has NVIDIA's driver, so that Warp may find a GPU; asking Warp itself takes a second."""
    try:
        ctypes.CDLL("libcuda.so.1")
    except OSError:
        return False
    return True


def _warp_devices(device: str) -> list[str]:
    import warp as wp

    from .span_workers import warp_device
    from .warp_start import start_quietly

    start_quietly()  # else Warp greets on standard output, where results are
    gpus = [str(gpu) for gpu in wp.get_cuda_devices()]
    names = {"auto": gpus[:1] or ["cpu"], "cuda": gpus or ["cuda"]}.get(device) or device.split(",")
    return [warp_device(name.strip()) for name in names]
