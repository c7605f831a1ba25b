"""Rows of a manifest that name recipes that could not be made, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..errors import SweepStoreError
from .manifest import Manifest, row_digest
from .same_results import Maker


def add_failures(manifest: Manifest, maker: Maker, failures: Mapping[str, str]) -> None:
    """Record which recipes (their hashes) could not be made, and why; earlier rows of the recipes are replaced."""
    rows = [(maker[0], recipe, why, row_digest(maker[1], recipe, why)) for recipe, why in failures.items()]
    with manifest.transaction():
        manifest.changed_by("INSERT OR REPLACE INTO failure VALUES (?, ?, ?, ?)", rows)


def remove_failures(manifest: Manifest, makers: Sequence[Maker], recipes: Sequence[str]) -> None:
    """Remove the rows of recipes."""
    with manifest.transaction():
        statements = [f"DELETE FROM failure WHERE maker = {number} AND recipe IN ({{}})" for number, _ in makers]
        for _ in manifest.among(statements, (), recipes):
            pass


def failures_of(manifest: Manifest, maker: Maker, damaged: list[str] | None) -> dict[str, str]:
    """Recipes (their hashes) that one code version could not make, and why.

    damaged: a damaged row is removed, and gets a sentence here; None: it raises SweepStoreError.
    """
    problem = str(manifest.run("PRAGMA integrity_check(failure)")[0][0])  # a row that is gone has no digest
    if problem != "ok":
        raise manifest.damaged(" ".join(problem.split()))
    digest = "digest" if manifest.version > 1 else "NULL"
    statement = f"SELECT rowid, CAST(recipe AS BLOB), CAST(sentence AS BLOB), {digest} FROM failure WHERE maker = ?"
    found: dict[str, str] = {}
    for number, recipe, sentence, own in manifest.run(statement, (maker[0],)):
        name = recipe.decode(errors="replace")
        if manifest.version == 1 or row_digest(maker[1], recipe, sentence) == own:
            found[name] = sentence.decode(errors="replace")
            continue
        lost = f"{manifest.path} is damaged: why recipe {name} could not be made is lost"
        if damaged is None:
            raise SweepStoreError(f"{lost}; run the sweep again")
        with manifest.transaction():
            manifest.run("DELETE FROM failure WHERE rowid = ?", (number,))
        damaged.append(lost)
    return found
