"""Show a palpate study in a PsychoPy window: python psychopy_client.py PORT TOKEN."""

import json
import select
import socket
import sys
import time

from psychopy import core, event, visual

NAMES = {"space": " ", "return": "enter", "period": ".", "comma": ",", "minus": "-"}
link = socket.create_connection(("127.0.0.1", int(sys.argv[1]))).makefile("rwb", 0)
clock, screen, typed = core.Clock(), json.loads(link.readline())["screen"], ""
words = visual.TextStim(window := visual.Window(fullscr=True), autoDraw=True)
# This program is the participant's page: when it ends, the array is switched off.
link.write(json.dumps({"page": True, "token": sys.argv[2]}).encode() + b"\n")
while True:
    while select.select([link], [], [], 0)[0]:
        news = json.loads(link.readline() or core.quit())  # nothing: the study ended
        # The array's time of each event on PsychoPy's clock, which begins at its import
        news["psychopy_time"] = core.getTime() - time.monotonic() + news["array_time"]
        with open("events.jsonl", "a") as file:
            file.write(json.dumps(news) + "\n")
        if news["event"] in ("screen", "error"):
            screen, typed = screen | news, ""  # an error's text stands for the screen's
            window.callOnFlip(lambda: (event.clearEvents(), clock.reset()))
    words.text = "\n\n".join([screen[p] for p in ("text", "choices", "hint")] + [typed])
    window.flip()
    keys = {k["key"].removeprefix("Arrow").lower(): k["key"] for k in screen["keys"]}
    for name, took in event.getKeys(timeStamped=clock):
        name = NAMES.get(name, name)
        typed = typed[:-1] if name == "backspace" else typed + name[: len(name) == 1]
        if name in keys or name == "enter":
            answer = {"press": keys[name]} if name in keys else {"give": typed}
            shown = {"screen": screen["number"], "seconds": took, "token": sys.argv[2]}
            link.write(json.dumps(answer | shown).encode() + b"\n")
