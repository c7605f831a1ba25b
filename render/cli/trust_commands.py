"""What `palpate trust` does: find the code that files name, without running any, and note that it is accepted."""

from datetime import UTC, datetime
from pathlib import Path

from ..errors import StrategyError
from ..objects.functions.implicit_object import is_function_name
from ..objects.functions.user_function import find_function_code
from ..strategies.intersection_strategy import draft_strategy
from ..terminal import console
from ..trust.accepted_code import Accepted, accept, entries, forget
from ..trust.permission import UNNAMED, Code
from ..trust.user_code import find_file


def run_trust(files: list[str] | None, remove: list[str] | None, *, as_json: bool) -> None:
    """Accept, remove, and list what is accepted then."""
    codes = [code for file in files or () for code in code_of(file)]  # all of them, before any is accepted
    removed = [entry for word in remove or () for entry in _meant(word)]
    for code in codes:
        accept(_entry(code))
    for entry in removed:
        forget(entry.digest)
    known = entries()
    if as_json:
        values = {"accepted": [_entry(code).digest for code in codes], "removed": [entry.digest for entry in removed]}
        console.show_values({**values, "entries": [vars(entry) for entry in known]}, as_json=True, title="")
        return
    console.show_values(
        {entry.digest[:16]: _entry_text(entry) for entry in known}, as_json=False, title="accepted code"
    )


def code_of(file: str) -> list[Code]:
    """The code that a file names, or is; raises StrategyError if it is none and names none, and what reading raises."""
    if is_function_name(file):
        return [find_function_code(file).code]
    path = Path(file)
    if not path.is_file():
        raise StrategyError(f"{file}: there is no such file")
    if path.suffix == ".py":
        try:
            return [find_file(path, UNNAMED).code]
        except OSError as error:
            raise StrategyError(f"{file}: cannot be read ({error.strerror or error})") from error
    if path.suffix == ".toml":
        from ..sweeps.plan.loading import draft_plans

        found = list(draft_plans([path]).code)
    elif path.suffix == ".json":
        found = draft_strategy(str(path))[1]
    else:
        raise StrategyError(f"{file}: must be a strategy (.json), a plan (.toml) or Python (.py)")
    if not found:
        raise StrategyError(f"{file}: names no code, so there is nothing to accept")
    return found


def _entry(code: Code) -> Accepted:
    when = datetime.now(UTC).isoformat(timespec="seconds")
    return Accepted(code.digest, code.name, code.namer.path, tuple(path for path, _ in code.files), when)


def _meant(word: str) -> list[Accepted]:
    """Entries of a file, as code or as what names it, or whose digest begins so; StrategyError if there are none."""
    path = str(Path(word).resolve())
    whole = word.lower()
    found = [
        entry
        for entry in entries()
        if path in (entry.named_by, *entry.files) or (len(whole) >= 8 and entry.digest.startswith(whole))
    ]
    if not found:
        raise StrategyError(f"--remove {word}: nothing of that file or SHA-256 is accepted")
    return found


def _entry_text(entry: Accepted) -> str:
    named = f", named by {entry.named_by}" if entry.named_by else ""
    return f"{entry.name} ({', '.join(entry.files)}){named}, {entry.when}"
