"""Results from a GPU to the host, through pinned memory, while the GPU goes on with the next chunk."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp


class Downloader:
    """Brings one worker's results down on a stream of its own; for one thread, one download at a time.

    Warp's current stream belongs to the device, not to the thread, so workers on one GPU take turns in computing on
    it; copies are told their stream one by one, and need no turn.

    Arrays of Warp's memory pool (its default on CUDA) are given back in the order of the device's current stream, which
    knows nothing of this one: they are kept here until their copies are done.
    """

    def __init__(self, device: str) -> None:
        self._device = wp.get_device(device)
        self._stream = wp.Stream(self._device)
        self._pinned: dict[str, Any] = {}
        self._under_way: dict[str, tuple[Any, Any]] = {}

    def start(self, arrays: Mapping[str, Any]) -> None:
        """Queue copies of arrays after all that the device's current stream has been given so far."""
        self._stream.wait_stream(self._device.stream)
        for name, array in arrays.items():
            landing = self._landing(name, array)
            wp.copy(landing, array, stream=self._stream)
            self._under_way[name] = (landing, array)

    def finish(self) -> dict[str, np.ndarray]:
        """The arrays by name, once they are down, in memory of their own: the pinned one serves the next chunk."""
        wp.synchronize_stream(self._stream)
        host = {name: np.array(landing.numpy()) for name, (landing, _) in self._under_way.items()}
        self._under_way.clear()
        return host

    def _landing(self, name: str, array: Any) -> Any:
        """Pinned memory in the array's shape; it grows, by a quarter more than needed, and is used again."""
        size = array.size * wp.types.type_size_in_bytes(array.dtype)
        held = self._pinned.get(name)
        if held is None or held.shape[0] < size:
            held = wp.empty(size + size // 4 + 1, dtype=wp.uint8, device="cpu", pinned=True)
            self._pinned[name] = held
        return wp.array(ptr=held.ptr, dtype=array.dtype, shape=array.shape, capacity=size, device="cpu", pinned=True)
