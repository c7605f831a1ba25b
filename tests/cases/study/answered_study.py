"""Run a study and be its participant: `python -m answered_study palpate study plan.toml --no-browser`.

It speaks the page's own protocol over its WebSocket, agrees to the consent, and presses the first key of all else.
"""

import json
import re
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from typing import Any

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

PERIOD = 0.03  # [s] between looks at the screen
PAGE = re.compile(r"http://(\S+:\d+)(/\S*)")


class PageClient:
    """What a participant's page is to the server, without a browser. address: as the command tells it."""

    def __init__(self, address: str) -> None:
        found = PAGE.search(address)
        assert found is not None, address
        self._stack = ExitStack()
        self.connection: ClientConnection = self._stack.enter_context(
            connect(f"ws://{found[1]}{found[2]}", open_timeout=10, compression=None)
        )
        self.screen: dict[str, Any] = {}
        self.number = -1

    def ask(self, **request: Any) -> dict[str, Any]:
        """The JSON of the answer to a request."""
        self.connection.send(json.dumps(request))
        answer = self.connection.recv(timeout=10)
        size = int.from_bytes(answer[:4], "little")
        return json.loads(answer[4 : 4 + size])

    def close(self) -> None:
        """As a person closes the page."""
        self._stack.close()

    def look(self) -> bool:
        """Ask for the screen; whether it is another one."""
        answer = self.ask(ask="screen", after=self.number)
        if answer["kind"] == "failure":
            raise RuntimeError(answer["text"])
        is_new = answer["number"] != self.number
        if is_new:
            self.number, self.screen = answer["number"], answer["screen"]
        return is_new

    def answer(self) -> None:
        """Press or type what a screen asks for: of the consent the last key, which agrees; else the first one."""
        keys, question = self.screen["keys"], self.screen["question"]
        if keys:
            is_consent = question is not None and not self.screen["title"] and len(keys) == 2
            self.ask(ask="press", screen=self.number, key=keys[-1 if is_consent else 0]["key"], seconds=0.5)
        elif question is not None:
            value = "nothing" if question["kind"] == "text" else question["low"] or 0
            self.ask(ask="give", screen=self.number, value=value, seconds=0.5)


def take_part(address: str) -> None:
    """Answer everything until the study has ended."""
    page = PageClient(address)
    try:
        while page.screen.get("kind") != "ended":
            if page.look():
                page.answer()
            time.sleep(PERIOD)
    except (WebSocketException, OSError):  # the study has ended, or was stopped
        return
    finally:
        page.close()


def run_answered(command: list[str]) -> int:
    """Exit code of a study whose participant answers; what it prints goes on."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            sys.stdout.write(line)
            if "participant's page: " in line:
                threading.Thread(target=take_part, args=(line,), daemon=True).start()
    return process.returncode


if __name__ == "__main__":
    sys.exit(run_answered(sys.argv[1:]))
