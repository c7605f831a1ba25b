"""Downloading of results from a GPU, through pinned memory, while the GPU goes on with the next chunk."""

import weakref
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp


class Landed:
    """An array in pinned memory that NumPy views; once no view is left, the memory is used for another chunk."""

    def __init__(self, held: Any, view: np.ndarray) -> None:
        self._held = held
        self.__array_interface__ = view.__array_interface__


class Downloader:
    """Downloads one worker's results on a stream of its own; for one thread, one download at a time.

    Warp's current stream belongs to the device, not to the thread, so workers on one GPU take turns in computing on
    it. Each copy is given its stream, and needs no turn.

    Warp's memory pool (its default on CUDA) takes an array back in the order of the device's current stream, which
    does not wait for this one. So arrays are held here until their copies are done.

    The results are views of the pinned memory. To copy them would take longer than to compute them: a process gets
    pages of new memory one at a time, whatever the number of its threads.
    """

    def __init__(self, device: str) -> None:
        self._device = wp.get_device(device)
        self._stream = wp.Stream(self._device)
        self._free: dict[str, list[Any]] = {}
        self._under_way: dict[str, tuple[Any, Any, Any]] = {}

    def start(self, arrays: Mapping[str, Any]) -> None:
        """Queue copies of arrays after all that the device's current stream has been given so far."""
        self._stream.wait_stream(self._device.stream)
        for name, array in arrays.items():
            held = self._room(name, array.size * wp.types.type_size_in_bytes(array.dtype))
            landing = wp.array(
                ptr=held.ptr, dtype=array.dtype, shape=array.shape, capacity=held.capacity, device="cpu", pinned=True
            )
            wp.copy(landing, array, stream=self._stream)
            self._under_way[name] = (held, landing, array)

    def finish(self) -> dict[str, np.ndarray]:
        """The arrays by name; waits for their copies."""
        wp.synchronize_stream(self._stream)
        host = {}
        for name, (held, landing, _) in self._under_way.items():
            landed = Landed(held, landing.numpy())
            weakref.finalize(landed, self._free[name].append, held)
            host[name] = np.asarray(landed)
        self._under_way.clear()
        return host

    def _room(self, name: str, size: int) -> Any:
        """Pinned memory of at least that many bytes: some that is free again, or new, a quarter larger than needed."""
        free = self._free.setdefault(name, [])
        while free:
            held = free.pop()
            if held.capacity >= size:
                return held  # smaller ones are let go
        return wp.empty(size + size // 4 + 1, dtype=wp.uint8, device="cpu", pinned=True)
