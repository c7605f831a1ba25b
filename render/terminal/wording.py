"""Messages name arguments as Python writes them; commands show those that they have as their options or plan keys.

| in Python | as an option | as a key of a plan |
|---|---|---|
| `fit=0.13` | `--fit 0.13` | `fit = 0.13` |
| `at=(0, 0, 0.2)` | `--at 0 0 0.2` | `at = [0, 0, 0.2]` |
| `overwrite=True`, `mode="overwrite"` | `--overwrite` | |
| `mode="resume"`, in another command than render | `palpate render --resume` | |
| `up must be ...`, where a message begins so | `--up must be ...` | |
"""

import re
from collections.abc import Collection

_VALUE = r'"[^"]*"|\([^()]*\)|(?:[^\s,;:()]|:(?=\S)|\.(?=\d))+'
_ARGUMENT = re.compile(rf"(?<![\w.-])([a-z_]+)=({_VALUE})")
_SUBJECT = re.compile(r"([a-z_]+)(?= (?:must|is of|is for|means)\b)")


class Wording:
    """Writes arguments as the running command does.

    options: names of its options, as Python has them; others: those of other commands; keys: those of a plan,
    which have precedence.
    """

    def __init__(self, options: Collection[str] = (), others: Collection[str] = (), keys: Collection[str] = ()) -> None:
        self.options, self.keys = frozenset(options), frozenset(keys)
        self.all = self.options | frozenset(others)

    def __call__(self, message: str) -> str:
        """The message with arguments as options, or as keys of a plan."""
        first = _SUBJECT.match(message)
        if first and first[1] in self.options:
            message = _option(first[1]) + message[first.end() :]
        return _ARGUMENT.sub(lambda match: self._argument(match[1], match[2]) or match[0], message)

    def _argument(self, name: str, value: str) -> str | None:
        text = value.strip('"')
        if name == "mode" and text in self.all:
            return _option(text) if text in self.options else f"palpate render {_option(text)}"
        if name in self.keys:
            return f"{name} = {value.replace('(', '[').replace(')', ']')}"
        if name in self.all:
            return _option(name) if value == "True" else f"{_option(name)} {text.strip('()').replace(',', '')}"
        return None


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")
