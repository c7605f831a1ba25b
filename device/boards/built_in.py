"""The arrays that palpate has, in the order in which they are listed."""

from __future__ import annotations

from .autd3.kind import KIND as AUTD3
from .emulator.kind import KIND as EMULATOR
from .pat16.kind import KIND as PAT16
from .sonicsurface.kind import KIND as SONICSURFACE
from .stratos.kind import KIND as STRATOS

BUILT_IN = (EMULATOR, PAT16, SONICSURFACE, AUTD3, STRATOS)
"""All of them. A new one has a folder here, and its line above."""
