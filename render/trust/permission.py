"""Code that data name is run only where a person said so.

| who says so | what then runs |
|---|---|
| `--allow-code`, `allow_code=True` | all code that this command, or this call, names |
| `palpate trust FILE` | code whose files, and the file that names it, are as they were then (`trust_store`) |
| the parent of a sweep | in its workers, files with the SHA-256 of those that the parent ran |

Code that a script passes as an object (a function, a registered stage) needs no permission, nor does a module that this
process has imported already: loading it runs nothing.
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
"""True: all code; False: what the store has accepted; a set: files with one of these SHA-256, and no other."""


@dataclass(frozen=True)
class Namer:
    """The data that name code."""

    path: str = ""
    """Their file; empty: a command line, or a script."""
    sha256: str = ""
    """Of their text; empty: a person wrote the name."""

    @classmethod
    def of(cls, path: object, text: str) -> "Namer":
        """A file of data and its text."""
        return cls(str(path), hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest())


UNNAMED: Final = Namer()
"""A person wrote the name."""


@dataclass(frozen=True)
class Code:
    """Code that data name, found and read; none of it was run."""

    name: str
    """As the data have it: a module, `file.py:function`, `package.module:function`; or a file alone."""
    files: tuple[tuple[str, str], ...]
    """Path and SHA-256 of each file that would run: of a module in packages, theirs come first."""
    namer: Namer = UNNAMED
    is_loaded: bool = False
    """Whether this process has imported it, as it is now."""

    @property
    def digest(self) -> str:
        """SHA-256 of the files' content, the name, and the text of what names them: what `palpate trust` accepts."""
        lines = [FORMAT, self.namer.sha256, self.name if self.namer.sha256 else "", *(sha for _, sha in self.files)]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()

    @property
    def acceptable(self) -> str:
        """What `palpate trust` is given to accept it; empty for a text that is no file's."""
        if self.namer.sha256:
            return self.namer.path
        is_file = self.name.rpartition(":")[0].endswith(".py") or self.name.endswith(".py")
        return self.files[-1][0] if is_file and self.files else self.name

    @property
    def title(self) -> str:
        """In sentences."""
        files = ", ".join(f"{path}, SHA-256 {sha256[:16]}" for path, sha256 in self.files)
        return f"{self.name} ({files or 'no file: a part of Python itself, or a folder'})"


def require_permission(codes: Sequence[Code], allow_code: AllowCode) -> None:
    """Raise UntrustedCodeError, which lists what would run, unless all of it may; runs nothing."""
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
    """What would run, and how to permit it."""
    titles = "; ".join(dict.fromkeys(code.title for code in codes))
    words = dict.fromkeys(code.acceptable for code in codes)
    accepts = f", `palpate trust {shlex.join(words)}` accepts it as it is now" if all(words) else ""
    return (
        f"this would run code: {titles}. Read it first: it can do all that you can. --allow-code (allow_code=True in "
        f"Python) runs it this once{accepts}"
    )
