"""Real-time scheduling where the system permits it."""

import gc
import os
import subprocess
import sys

CODE = (
    "import gc, os; from palpate.device.live.realtime import enter_realtime, stop_collecting; "
    "permitted = enter_realtime(7); stop_collecting(); "
    "print(permitted, os.sched_getscheduler(0) == os.SCHED_FIFO, os.sched_getparam(0).sched_priority, gc.isenabled())"
)


def test_a_process_says_whether_it_is_scheduled_in_real_time():
    output = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True).stdout
    permitted, is_fifo, priority, collects = output.split()
    assert (permitted, collects) == (is_fifo, "False")
    assert priority == ("7" if permitted == "True" else "0")
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
    assert gc.isenabled()
