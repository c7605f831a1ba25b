"""Run a command until it tells an address, then press Ctrl-C: `python -m interrupted_command palpate view a.h5`."""

import signal
import subprocess
import sys


def run_until_address(command: list[str]) -> int:
    """Exit code of a command that is interrupted when a line of its output has an address; the output goes on."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            sys.stdout.write(line)
            if "http://" in line:
                process.send_signal(signal.SIGINT)
    return process.returncode


if __name__ == "__main__":
    sys.exit(run_until_address(sys.argv[1:]))
