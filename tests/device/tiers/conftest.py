"""Tests that need umockdev are skipped, with the reason, where it is missing; asked only when one of them runs."""

from __future__ import annotations

import pytest
from umockdev_session import missing


@pytest.fixture(scope="session")
def umockdev() -> None:
    """Skip a test where umockdev cannot run."""
    if reason := missing():
        pytest.skip(reason)
