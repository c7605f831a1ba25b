"""Permission to run code that is named by data files; without it such code never runs.

| permission by | code that may run |
|---|---|
| `--allow-code`, `allow_code=True` | all code that the files of this command or call name |
| `palpate trust FILE` | code whose files, and the file that names it, have not changed since (`accepted_code`) |
| the parent process of a sweep | in its workers, files with the SHA-256 of those that the parent ran |

Code that a script passes as an object (a function, a registered stage) needs no permission. Nor does a module that this
process has imported already, because loading it again runs nothing.
"""

import hashlib
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ..errors import UntrustedCodeError
from .accepted_code import accepted

FORMAT = "palpate code 1"

AllowCode = bool | frozenset[str]
"""True: all code; False: code that `palpate trust` has accepted; a set: only files with one of these SHA-256."""


@dataclass(frozen=True)
class Namer:
    """Source of a name of code: a data file, or the user."""

    path: str = ""
    """Path of the data file; empty: a command line, or a script."""
    sha256: str = ""
    """SHA-256 of its text; empty: the user gave the name."""

    @classmethod
    def of(cls, path: object, text: str) -> "Namer":
        """Namer for a data file with this text."""
        return cls(str(path), hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest())


UNNAMED: Final = Namer()
"""The user gave the name."""


@dataclass(frozen=True)
class Code:
    """Code that a data file or the user names: located and read, not run."""

    name: str
    """Name as given: a module, `file.py:function`, `package.module:function`, or a file."""
    files: tuple[tuple[str, str], ...]
    """Path and SHA-256 of each file that would run; files of the packages around a module come first."""
    namer: Namer = UNNAMED
    is_loaded: bool = False
    """Whether this process has already imported exactly this code."""

    @property
    def digest(self) -> str:
        """SHA-256 over the files' contents, the name and the naming file's text; `palpate trust` stores it."""
        lines = [FORMAT, self.namer.sha256, self.name if self.namer.sha256 else "", *(sha for _, sha in self.files)]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()

    @property
    def acceptable(self) -> str:
        """Argument of `palpate trust` that accepts this code; empty if a text without a file names it."""
        if self.namer.sha256:
            return self.namer.path
        is_file = self.name.rpartition(":")[0].endswith(".py") or self.name.endswith(".py")
        return self.files[-1][0] if is_file and self.files else self.name

    @property
    def title(self) -> str:
        """Name and files, for messages."""
        files = ", ".join(f"{path}, SHA-256 {sha256[:16]}" for path, sha256 in self.files)
        return f"{self.name} ({files or 'no file: a part of Python itself, or a folder'})"


def require_permission(codes: Sequence[Code], allow_code: AllowCode) -> None:
    """Raise UntrustedCodeError, which lists the code, unless all of it may run; runs nothing."""
    codes = [code for code in codes if not code.is_loaded]
    if allow_code is True or not codes:
        return
    if isinstance(allow_code, frozenset):
        changed = [code for code in codes if not code.files or any(sha not in allow_code for _, sha in code.files)]
        if changed:
            raise UntrustedCodeError(
                f"{'; '.join(code.title for code in changed)}: is not the code that was permitted when the sweep was "
                "begun; it has changed since, so it is not run"
            )
        return
    known = accepted()
    if refused := [code for code in codes if code.digest not in known]:
        raise UntrustedCodeError(_refusal(refused))


def _refusal(codes: Sequence[Code]) -> str:
    """Error message: the code that would run, and how to permit it."""
    titles = "; ".join(dict.fromkeys(code.title for code in codes))
    words = dict.fromkeys(code.acceptable for code in codes)
    accepts = f", `palpate trust {shlex.join(words)}` accepts it as it is now" if all(words) else ""
    return (
        f"this would run code: {titles}. Read it first: it can do all that you can. allow_code=True "
        f"runs it this once{accepts}"
    )
