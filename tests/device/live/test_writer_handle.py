"""The parent's side of a writer's process."""

import os
import signal
import time

import pytest

from palpate.device import array_model
from palpate.device.live import writer_handle
from palpate.device.live.writer_handle import WriterHandle
from palpate.device.live.writer_process import ArrayRequest
from palpate.device.registry import kind_of


@pytest.mark.exhaustive
def test_a_process_that_hangs_and_reads_no_orders_is_ended(monkeypatch):
    monkeypatch.setattr(writer_handle, "OFF_TIMEOUT", 0.1)
    model = array_model("emulator")
    request = ArrayRequest(kind=kind_of(model), model=model, emulated=True)
    handle = WriterHandle([request], update_rate=10e3, realtime=False)
    os.kill(handle.process_id, signal.SIGSTOP)
    began = time.monotonic()
    for _ in range(10):  # more than the socket holds
        handle.send("stop", filler="x" * 60_000)
    handle.close()
    assert time.monotonic() - began < 5.0
    assert handle._process.returncode == -signal.SIGKILL
    handle.release()
