"""Arrays -> one text that a page holds: small numbers, deflated, in base64."""

import base64
import hashlib
import zlib
from typing import Any

import numpy as np

STEP = 1e-5  # [m] positions are rounded to; more only where an array of them is over 0.65 m wide
_TOP = (1 << 16) - 1


class Packer:
    """Collects arrays; each gets a description with which the page finds and reads it.

    | codec | bytes |
    |---|---|
    | f8, f4, u4, u2, u1 | little-endian numbers as they are |
    | steps | whole numbers n of origin + n * step, 0..65535; see `steps` |

    An array whose bytes are there already is not stored again, as the mesh of two renderings of one object.
    exact: positions stay float32, for a page on the same machine, where bytes cost less than packing them.
    """

    def __init__(self, *, exact: bool = False) -> None:
        self._exact = exact
        self._blocks: list[bytes] = []
        self._size = 0
        self._known: dict[bytes, int] = {}

    def numbers(self, values: np.ndarray, codec: str) -> dict[str, Any]:
        """Store numbers as they are, in a type of NumPy that has the name of the codec."""
        array = np.ascontiguousarray(values)
        return {"codec": codec, "shape": list(array.shape), "at": self._store(array.astype(f"<{codec}").tobytes())}

    def positions(self, values: np.ndarray) -> dict[str, Any]:
        """Store positions [m] in steps of 0.01 mm, or of 1/65535 of their extent where that is more.

        values: shape [row, column]; rows that are close to those before them take few bytes.
        """
        if self._exact:
            return self.numbers(values, "f4")
        values = np.asarray(values, np.float64)
        origin = float(values.min()) if values.size else 0.0
        extent = float(values.max()) - origin if values.size else 0.0
        step = max(STEP, extent / _TOP)
        return self.steps(np.round((values - origin) / step), origin, step)

    def indices(self, values: np.ndarray, count: int) -> dict[str, Any]:
        """Store indices below `count` exactly, shape [row, column]."""
        return self.steps(values, 0.0, 1.0) if count <= _TOP + 1 else self.numbers(values, "u4")

    def steps(self, values: np.ndarray, origin: float, step: float) -> dict[str, Any]:
        """Store whole numbers 0..65535 of shape [row, column], which mean origin + n * step.

        Column by column, each number is stored as its difference d from the one in the row before (from 0 in the first
        row), modulo 65536 in -32768..32767, and that as 2 d, or -2 d - 1 where d < 0. All low bytes come first, then
        all high bytes: deflate finds most of the latter to be 0.
        """
        whole = np.asarray(values).astype(np.int64)
        change = np.diff(whole, axis=0, prepend=0).T.astype(np.uint16).view(np.int16).astype(np.int32)
        folded = ((change << 1) ^ (change >> 31)).astype(np.uint16)
        content = (folded & 0xFF).astype(np.uint8).tobytes() + (folded >> 8).astype(np.uint8).tobytes()
        return {
            "codec": "steps",
            "shape": list(whole.shape),
            "at": self._store(content),
            "origin": origin,
            "step": step,
        }

    def _store(self, content: bytes) -> int:
        digest = hashlib.sha256(content).digest()
        if digest not in self._known:
            self._known[digest] = self._size
            self._blocks.append(content)
            self._size += len(content)
        return self._known[digest]

    def content(self) -> bytes:
        """All that was stored."""
        return b"".join(self._blocks)

    def text(self) -> str:
        """All that was stored, as base64 of a zlib stream."""
        return base64.b64encode(zlib.compress(self.content(), 9)).decode("ascii")
