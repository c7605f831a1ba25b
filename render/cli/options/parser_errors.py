"""What the option parser refuses, in words that name the value and the way out.

| refused | said besides |
|---|---|
| an argument or option is missing | what it is |
| a value is no number, or outside its bounds | the value, what is wanted, the bound |
| an option takes several values | which, and that blanks are between them |
| an option is unknown, and has another name here | that name |
| there are more arguments than the command takes | which it takes |
"""

import re
from collections.abc import Mapping
from typing import Any

WANTED = {"float": "no number", "int": "no whole number", "bool": "neither true nor false"}
BOUNDS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}
LIKELY_OPTIONS = {
    **dict.fromkeys(("--output", "--output-file", "--to"), "--out"),
    **dict.fromkeys(("--force", "--replace", "-f", "-y"), "--overwrite"),
    **dict.fromkeys(("--size", "--length"), "--fit"),
    **dict.fromkeys(("--position", "--pos", "--translate", "--center", "--centre"), "--at"),
    **dict.fromkeys(("--rotation", "--turn"), "--rotate"),
    **dict.fromkeys(("--fps", "--pose-rate"), "--rate"),
    **dict.fromkeys(("--loop", "--repeat", "--loops"), "--repeats"),
    **dict.fromkeys(("--simulate", "--simulated", "--virtual", "--dry-run"), "--emulate"),
    **dict.fromkeys(("--gpu", "--cuda"), "--device"),
    **dict.fromkeys(("--jobs", "-j", "--threads", "--cores", "--processes"), "--workers"),
    **dict.fromkeys(("--silent", "--no-progress"), "--quiet"),
    **dict.fromkeys(("--seconds", "--time", "--length-seconds"), "--duration"),
    **dict.fromkeys(("--intensity", "--strength", "--volume", "--level"), "--level-max"),
    **dict.fromkeys(("--frequency", "--freq", "--hz"), "--update-rate"),
    **dict.fromkeys(("--board", "--device-name"), "--array"),
    **dict.fromkeys(("--format", "--type"), "--to"),
    **dict.fromkeys(("--range", "--frames", "--slice"), "--poses"),
    **dict.fromkeys(("--stride", "--step-size"), "--every"),
    "--compression": "--gzip",
    "--resolution": "--spacing",
}
"""Options of ours by words of other programs."""
_SEVERAL = re.compile(r"Option '(-\S+)' requires (\d+) arguments")


def explain(error: Any, command: Any, commands: Mapping[str, Any]) -> None:
    """Complete the message of a parser's error on a command's arguments; commands: all of its group, by name."""
    parameter = getattr(error, "param", None)
    if hasattr(error, "param_type") and parameter is not None:  # one is missing
        error.message = f"It is: {parameter.help}" if parameter.help else ""
    elif parameter is not None and (faults := getattr(error.__cause__, "errors", None)) is not None:
        error.message = _fault(faults()[0], error.message, parameter)
    elif several := _SEVERAL.match(error.message):
        option = next(option for option in command.params if several[1] in option.opts)
        error.message = f"{several[1]} takes {several[2]} values, {option.metavar}, with blanks between: {option.help}"
    elif LIKELY_OPTIONS.get(name := getattr(error, "option_name", "")) in option_words(command):
        error.possibilities = [LIKELY_OPTIONS[name]]
    elif having := [other for other, one in commands.items() if name and name in option_words(one)]:
        error.message, error.possibilities = f"{error.message}, which is of {', '.join(having)}", []
    elif error.message.startswith("Got unexpected extra argument"):
        taken = [one.metavar for one in command.params if one.param_type_name == "argument"]
        error.message = f"{error.message}: this command takes {' '.join(taken) or 'options only'}"


def option_words(command: Any) -> set[str]:
    """All words by which a command's options are called."""
    return {word for option in command.params for word in option.opts}


def _fault(fault: dict[str, Any], message: str, parameter: Any) -> str:
    """What is wrong with a value, which pydantic leaves out of its message."""
    value, bound = fault.get("input"), fault.get("ctx", {})
    kind = str(fault.get("type", "")).partition("_")[0]
    what = WANTED.get(kind)
    limits = [f"{word} {bound[name]}" for name, word in BOUNDS.items() if name in bound]
    if what is None and not limits:
        return message
    return f"{value!r} is {what}. {parameter.help}" if what else f"it must be {limits[0]}, not {value}"
