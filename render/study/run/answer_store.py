"""The data of a study's participants: each interval and each answer is on the disk when the call that adds it returns.

One SQLite file, `answers.sqlite`, in the study's folder; docs/formats/study-data.md describes its tables. Participants
are codes; no name is asked for, and the machine is described without its name, which often is a person's.
"""

import contextlib
import difflib
import hashlib
import json
import os
import platform
import sqlite3
import time
from collections.abc import Callable, Generator, Mapping
from dataclasses import asdict, fields
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ....datasets.json_text import parse_json
from ....datasets.known_names import likely_name
from ....datasets.storage.durable import FolderLock, is_locked, sync
from ...errors import StudyError, StudyStorageError
from ...live.recorder import spool_folder
from ..plan.study_plan import StudyPlan
from .study_file import (
    LISTS,
    AnswerRow,
    IntervalRow,
    ParticipantProgress,
    SessionSetup,
    StudyFile,
    columns_of,
    json_text,
    storable,
)

POSES = "poses"
"""Folder, beside the data file, of the contour files of live intervals."""
TAKEN_CODES = (
    "SELECT code FROM answers UNION SELECT code FROM intervals UNION SELECT code FROM events WHERE name = 'trial_begun'"
)
"""Codes of participants who have felt or answered something."""
JUMP_SECONDS = 1.0
"""A wall clock that moves by more against CLOCK_MONOTONIC has jumped: it was set, or the machine slept [s]."""
_LINES_SHOWN = 3  # of a plan, that differ


class AnswerStore:
    """A study's data, open for one participant at a time; a context manager.

    Every `add_...` is a transaction of its own, which is on the disk when the call returns. One that raises StudyError
    has changed nothing, and may be called again. Threads may share a store.

    Raises:
        StudyError: The data were begun with another plan, or their file cannot be used.
    """

    def __init__(self, folder: str | os.PathLike[str], plan: StudyPlan) -> None:
        self.folder = Path(folder)
        self._plan = plan
        self._plan_sha256 = hashlib.sha256(plan.text.encode()).hexdigest()
        self._file = StudyFile(self.folder)
        self._lock: FolderLock | None = None
        self._code = ""
        self._session = 0
        self._unsaved: IntervalRow | AnswerRow | None = None
        self._last = (0.0, 0.0)  # of the wall clock and of CLOCK_MONOTONIC, when the last row was saved [s]
        try:
            self._keep_plan()
        except BaseException:
            self.close()
            raise

    def __repr__(self) -> str:
        return f"AnswerStore({str(self.folder)!r}, participant={self._code!r})"

    def __enter__(self) -> "AnswerStore":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file, and let another process have the participant; closing twice does nothing."""
        self._file.close()
        self._release()

    @property
    def path(self) -> Path:
        """Of the data file."""
        return self._file.path

    def keep_stimuli(self, stimuli: Mapping[str, tuple[str | None, float | None]]) -> None:
        """Keep each stimulus' SHA-256, of the files that it is made of, and its value on the plan's own scale.

        Raises StudyError where one has changed since the first participant: answers to both cannot be compared.
        """
        with self._file.transaction("the stimuli") as connection:
            kept = {row["name"]: row for row in connection.execute("SELECT * FROM stimuli")}
            for name, (digest, value) in stimuli.items():
                if name not in kept:
                    values = {"name": name, "sha256": digest, "value": value, "since": utc(time.time())}
                    _insert(connection, "stimuli", values)
                elif kept[name]["sha256"] != digest:
                    since = kept[name]["since"]
                    was, now = (str(own)[:16] for own in (kept[name]["sha256"], digest))
                    raise StudyError(
                        f"a file of stimulus {name!r} has changed since {since}: its SHA-256 was {was}... "
                        f"and is {now}...: put the old file back, or begin another data folder"
                    )

    def note_array(self, *, lead: float, realtime: bool) -> None:
        """Keep how the array was opened: how far ahead frames are written [s], and whether with real-time priority."""
        with self._file.transaction("how the array was opened") as connection:
            values = (lead, int(realtime), self._session)
            connection.execute("UPDATE sessions SET lead = ?, realtime = ? WHERE id = ?", values)

    def next_code(self) -> str:
        """The first code of the plan that no participant has had yet; raises StudyError where all are taken.

        A run that ended before the first answer and interval leaves its code free.
        """
        taken = {row["code"] for row in self._file.rows(f"SELECT code FROM ({TAKEN_CODES})")}
        locked = {code for code in self._plan.codes if is_locked(self.folder / f"{code}.lock")}
        free = next((code for code in self._plan.codes if code not in taken | locked), None)
        if free is None:
            raise StudyError(
                f"all {len(self._plan.codes)} codes of the plan have begun: add some behind the others, or resume one "
                "with --participant CODE --resume"
            )
        return free

    def code_to_resume(self) -> str:
        """The code of the one participant who has begun and not finished; raises StudyError where that is not one."""
        begun = [
            row["code"]
            for row in self._file.rows(
                f"SELECT code FROM participants WHERE finished IS NULL AND code IN ({TAKEN_CODES}) ORDER BY number"
            )
        ]
        if len(begun) != 1:
            who = (
                f"{', '.join(begun)} have begun and not finished: name one"
                if begun
                else "nobody has begun: leave it out"
            )
            raise StudyError(f"--resume without --participant: {who}")
        last = self._file.rows("SELECT code FROM sessions ORDER BY id DESC LIMIT 1")[0]["code"]
        if last != begun[0]:
            who = f"{begun[0]} has begun and not finished, but {last} was here last: name one"
            raise StudyError(f"--resume without --participant: {who}")
        return begun[0]

    def emissions(self, since: float) -> list[tuple[float, float, float]]:
        """Onset, duration and seconds at full drive [s] of what this machine has played since a time, to whomever.

        since: of CLOCK_MONOTONIC, which counts from the machine's start.
        """
        rows = self._file.rows(
            "SELECT onset, seconds, coalesce(driven, seconds) AS driven "
            "FROM intervals JOIN sessions ON sessions.id = intervals.session "
            "WHERE boot = ? AND onset BETWEEN ? AND ? AND seconds > 0 ORDER BY onset",
            (boot_id(), since, time.monotonic()),
        )
        return [
            (row["onset"], row["seconds"], row["seconds"] if row["driven"] is None else row["driven"]) for row in rows
        ]

    def counts(self, code: str) -> dict[str, int]:
        """Answers and intervals of a participant on disk."""
        return {
            table: self._file.rows(f"SELECT count(*) FROM {table} WHERE code = ?", (code,))[0][0]
            for table in ("answers", "intervals")
        }

    def begin(self, code: str, *, resume: bool = False, setup: SessionSetup | None = None) -> ParticipantProgress:
        """Take a participant for this process, until `close`, `finish` or `forget`.

        resume: whether the participant may have begun already.

        Raises:
            StudyError: The plan lacks the code; the participant has finished, has begun and this is no resumption, or
                is run by another process.
        """
        codes = self._plan.codes
        if code not in codes:
            listed = ", ".join(codes) if len(codes) <= 8 else f"{codes[0]}, {codes[1]}, ... {codes[-1]}"
            raise StudyError(
                f"participant {code!r} is not in the plan{likely_name(code, codes)}: its codes are {listed}"
            )
        if self._lock is not None:
            raise StudyError(f"this process runs participant {self._code} already")
        try:
            self._lock = FolderLock(self.folder, f"{code}.lock")
        except BlockingIOError as error:
            raise StudyError(f"participant {code} is being run by another process, with this data folder") from error
        except OSError as error:
            raise StudyError(f"{error.filename or self.folder} cannot be locked: {error.strerror}") from error
        try:
            self._require_free(code, resume)
            self._begin_session(code, setup or SessionSetup())
            return self._progress()
        except BaseException:
            self._release()
            raise

    def add_interval(self, row: IntervalRow) -> None:
        """Save an interval that was played or stopped, and the SHA-256 of the file of its poses, which is synced."""
        more: dict[str, Any] = {"poses_sha256": None}
        if row.poses_file is not None:
            more["poses_sha256"] = _synced_digest(self.folder / POSES / row.poses_file)
        what = f"interval {row.interval} of trial {row.trial} of block {row.block!r}"

        def values(wall: float, monotonic: float) -> dict[str, Any]:
            began = None if row.onset is None else utc(wall - monotonic + row.onset)
            return {**columns_of(row), **more, "began": began, "recorded": utc(wall), "monotonic": monotonic}

        self._add_row("intervals", row, what, values)

    def add_answer(self, row: AnswerRow) -> None:
        """Save an answer. Raises StudyError, too, where the question has one."""
        if isinstance(row.value, float) and row.value != row.value:
            raise StudyError(f"the answer to {row.name!r} must be a number, not nan")

        def values(wall: float, monotonic: float) -> dict[str, Any]:
            return {**columns_of(row), "answered": utc(wall), "monotonic": monotonic}

        self._add_row("answers", row, f"the answer to {row.name!r} {_place(row)}", values)

    def add_event(self, name: str, **details: Any) -> None:
        """Save something that happened: a stop, a page that closes, a pause."""
        self._require_begun()
        with self._writing(f"the event {name!r}") as (connection, wall, monotonic):
            self._insert_event(connection, name, details, wall, monotonic)

    def finish(self) -> None:
        """Save that the participant has answered everything, and let go of the code: it cannot be begun again."""
        self._require_begun()
        with self._writing(f"the end of participant {self._code}") as (connection, wall, _):
            connection.execute("UPDATE participants SET finished = ? WHERE code = ?", (utc(wall), self._code))
        self._release()

    def forget(self) -> None:
        """Remove what was saved of a participant who does not agree to take part; refused once there are answers."""
        self._require_begun()
        with self._writing(f"that nothing is kept of participant {self._code}") as (connection, _, _):
            if connection.execute("SELECT count(*) FROM answers WHERE code = ?", (self._code,)).fetchone()[0]:
                raise StudyError(f"participant {self._code} has answers, which are kept")
            connection.execute("DELETE FROM participants WHERE code = ?", (self._code,))  # and all that refers to it
        self._release()

    def poses_path(self, block_position: int, trial: int, interval: int, attempt: int) -> Path:
        """A path that is free, in a folder that is made, for the contour file of a live interval.

        A process that was killed may have left a file, or the folder that it grows from; neither is overwritten.
        """
        self._require_begun()
        folder = self.folder / POSES
        stem = f"{self._code}-b{block_position:02}-t{trial:03}-i{interval}-a{attempt}"
        try:
            folder.mkdir(exist_ok=True)
            sync(self.folder)
        except OSError as error:
            raise StudyStorageError(f"{folder} cannot be made: {error.strerror}") from error
        path, number = folder / f"{stem}.h5", 1
        while os.path.lexists(path) or os.path.lexists(spool_folder(path)):
            number += 1
            path = folder / f"{stem}-{number}.h5"
        return path

    # The plan.

    def _keep_plan(self) -> None:
        """Keep the plan's text beside the data, or refuse another plan than they were begun with."""
        plan = self._plan
        own = (self._plan_sha256, plan.text, json.dumps(plan.codes), _content(plan))
        with self._file.transaction("the plan") as connection:
            kept = connection.execute("SELECT sha256, text, codes, content FROM plans ORDER BY rowid").fetchall()
            if not kept:
                connection.execute(
                    "INSERT INTO study VALUES (?, ?, ?, ?, ?, 0)",
                    (plan.title, plan.consent, plan.data_statement, version("palpate"), utc(time.time())),
                )
            elif own[0] == kept[-1]["sha256"]:
                return
            else:
                # Codes may be added at the end, because the numbers of the others stay; comments change nothing.
                codes = parse_json(kept[-1]["codes"])
                if own[3] != kept[-1]["content"] or list(plan.codes[: len(codes)]) != codes:
                    raise StudyError(self._differing(kept[-1]["text"]))
            connection.execute(
                "INSERT INTO plans VALUES (?, ?, ?, ?, ?) ON CONFLICT (sha256) DO NOTHING",
                (*own, utc(time.time())),
            )

    def _differing(self, kept: str) -> str:
        """The sentence that refuses a plan, with the first lines that differ from the one that was kept."""
        before, now = kept.splitlines(), self._plan.text.splitlines()
        shown: list[str] = []
        for tag, first, stop, other, end in difflib.SequenceMatcher(None, before, now, autojunk=False).get_opcodes():
            if tag != "equal":
                was, own = ("; ".join(lines).strip()[:200] for lines in (before[first:stop], now[other:end]))
                shown.append(f"line {other + 1} was {was!r}, now {own!r}")
        return (
            f"{self._plan.path} is another plan than the data in {self.path} were begun with: "
            f"{'; '.join(shown[:_LINES_SHOWN]) or 'files that it names differ'}"
            f"{f'; and {len(shown) - _LINES_SHOWN} more' if len(shown) > _LINES_SHOWN else ''}. Undo the change (only "
            "codes may be added, after the others), or name another data folder for the changed study"
        )

    # The participant.

    def _require_free(self, code: str, resume: bool) -> None:
        rows = self._file.rows(
            "SELECT began, finished, (SELECT count(*) FROM answers WHERE answers.code = participants.code) AS answers, "
            f"code IN ({TAKEN_CODES}) AS taken "
            "FROM participants WHERE code = ?",
            (code,),
        )
        if rows and rows[0]["finished"] is not None:
            raise StudyError(
                f"participant {code} finished at {rows[0]['finished']}: if this is another person, each needs a code "
                "of their own; codes may be added to the plan after the others"
            )
        if rows and not resume and rows[0]["taken"]:  # else nobody has taken part yet
            raise StudyError(
                f"participant {code} began at {rows[0]['began']} and has {rows[0]['answers']} answers: --resume goes "
                "on where they stopped; another person needs another code"
            )

    def _begin_session(self, code: str, setup: SessionSetup) -> None:
        latest = self._file.rows(
            "SELECT max(time) FROM (SELECT max(began) AS time FROM sessions UNION ALL SELECT max(recorded) FROM "
            "intervals UNION ALL SELECT max(answered) FROM answers UNION ALL SELECT max(recorded) FROM events)"
        )[0][0]
        wall, monotonic = time.time(), time.monotonic()
        number = self._plan.codes.index(code)
        values = {
            "code": code,
            "began": utc(wall),
            "monotonic": monotonic,
            "machine": f"{platform.system()} {platform.release()} {platform.machine()}",
            "python": platform.python_version(),
            "palpate": version("palpate"),
            "numpy": version("numpy"),
            "boot": boot_id(),
            "plan_sha256": self._plan_sha256,
            **{name: storable(value) for name, value in asdict(setup).items()},
        }
        with self._file.transaction(f"that participant {code} begins") as connection:
            connection.execute("INSERT OR IGNORE INTO participants VALUES (?, ?, ?, NULL)", (code, number, utc(wall)))
            session = _insert(connection, "sessions", values)
            self._code, self._session = code, session
            if latest is not None:
                self._note_jump(connection, (seconds_of(latest), None), (wall, monotonic))
        self._unsaved, self._last = None, (wall, monotonic)

    def _progress(self) -> ParticipantProgress:
        names = [own.name for own in fields(AnswerRow)]
        answers: dict[tuple[str, int, str], AnswerRow] = {}
        statement = f"SELECT {', '.join(names)} FROM answers WHERE code = ? ORDER BY sequence"
        for row in self._file.rows(statement, (self._code,)):
            values = {name: tuple(parse_json(row[name])) if name in LISTS else row[name] for name in names}
            own = AnswerRow(**{**values, "is_practice": bool(values["is_practice"])})
            answers[own.block, own.trial, own.name] = own
        attempts = self._file.rows(
            "SELECT block, trial, max(attempt) FROM intervals WHERE code = ? GROUP BY block, trial", (self._code,)
        )
        return ParticipantProgress(
            code=self._code,
            number=self._plan.codes.index(self._code),
            session=self._session,
            answers=answers,
            attempts={(own[0], own[1]): own[2] + 1 for own in attempts},
        )

    def _require_begun(self) -> None:
        if self._lock is None:
            raise StudyError("no participant has begun: call begin first")

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.remove()
            self._lock.release()
            self._lock, self._code = None, ""

    # Rows.

    def _add_row(
        self,
        table: str,
        row: IntervalRow | AnswerRow,
        what: str,
        values: Callable[[float, float], dict[str, Any]],
    ) -> None:
        self._require_begun()
        if row == self._unsaved and self._has(table, row):
            self._unsaved = None  # the disk had it, although the call that wrote it failed at its very end
            return
        self._unsaved = row
        try:
            with self._writing(what) as (connection, wall, monotonic):
                self._insert_row(connection, table, values(wall, monotonic))
        except sqlite3.IntegrityError as error:
            self._unsaved = None
            if error.sqlite_errorname != "SQLITE_CONSTRAINT_UNIQUE":
                raise
            saved = self._saved(table, row)
            raise StudyError(f"{what} of participant {self._code} is saved already: {saved}") from error
        self._unsaved = None

    @contextlib.contextmanager
    def _writing(self, what: str) -> Generator[tuple[sqlite3.Connection, float, float], None, None]:
        """A transaction, and what wall clock and CLOCK_MONOTONIC show [s]."""
        with self._file.lock:  # of two threads, the one that writes first reads the clocks first
            now = time.time(), time.monotonic()
            with self._file.transaction(what) as connection:
                self._note_jump(connection, self._last, now)
                yield connection, *now
            self._last = now

    def _note_jump(
        self, connection: sqlite3.Connection, before: tuple[float, float | None], now: tuple[float, float]
    ) -> None:
        """Save an event if the wall clock has moved otherwise than CLOCK_MONOTONIC, which nobody sets."""
        passed = now[0] - before[0]
        if passed < 0 or (before[1] is not None and abs(passed - (now[1] - before[1])) > JUMP_SECONDS):
            details = {
                "wall_before": utc(before[0]),
                "wall": utc(now[0]),
                "monotonic_before": before[1],
                "monotonic": now[1],
            }
            self._insert_event(connection, "clock_jump", details, *now)

    def _insert_row(self, connection: sqlite3.Connection, table: str, values: dict[str, Any]) -> None:
        connection.execute("UPDATE study SET sequence = sequence + 1")
        sequence = connection.execute("SELECT sequence FROM study").fetchall()[0][0]
        _insert(connection, table, {"sequence": sequence, "session": self._session, "code": self._code, **values})

    def _insert_event(
        self, connection: sqlite3.Connection, name: str, details: dict[str, Any], wall: float, monotonic: float
    ) -> None:
        values = {"name": name, "details": json_text(details), "recorded": utc(wall), "monotonic": monotonic}
        self._insert_row(connection, "events", values)

    def _has(self, table: str, row: IntervalRow | AnswerRow) -> bool:
        values = {"code": self._code, **columns_of(row)}
        where = " AND ".join(f"{name} IS ?" for name in values)
        return bool(self._file.rows(f"SELECT 1 FROM {table} WHERE {where}", tuple(values.values())))

    def _saved(self, table: str, row: IntervalRow | AnswerRow) -> str:
        """What is there instead of a row that was refused."""
        if isinstance(row, IntervalRow):
            return f"an interval is played once in attempt {row.attempt}"
        rows = self._file.rows(
            "SELECT value, answered FROM answers WHERE code = ? AND block = ? AND trial = ? AND name = ?",
            (self._code, row.block, row.trial, row.name),
        )
        return f"{rows[0]['value']!r:.80} at {rows[0]['answered']}" if rows else table


def boot_id() -> str:
    """Names the time since the machine was started, within which CLOCK_MONOTONIC may be compared; "" if unknown."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def utc(wall: float) -> str:
    """A time of the wall clock as ISO 8601 text, in UTC, whose order as texts is that of the times."""
    return datetime.fromtimestamp(wall, UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def seconds_of(text: str) -> float:
    """The time of the wall clock [s] that `utc` has made a text of."""
    return datetime.fromisoformat(text).timestamp()


def _insert(connection: sqlite3.Connection, table: str, values: dict[str, Any]) -> int:
    names, marks = ", ".join(values), ", ".join("?" * len(values))
    cursor = connection.execute(f"INSERT INTO {table} ({names}) VALUES ({marks})", tuple(values.values()))
    return int(cursor.lastrowid or 0)


def _content(plan: StudyPlan) -> str:
    """Digest of all that a plan decides, but for its codes; paths are relative to the plan, so that both may move."""
    values = asdict(plan)
    for name in ("path", "text", "codes"):
        del values[name]
    for stimulus in values["stimuli"]:
        for name in ("file", "solid", "shown", "strategy", "sampling"):
            if stimulus[name] is not None and os.path.isabs(stimulus[name]):
                stimulus[name] = os.path.relpath(stimulus[name], plan.path.parent)
    return hashlib.sha256(json.dumps(values, default=str, sort_keys=True).encode()).hexdigest()


def _synced_digest(path: Path) -> str:
    """SHA-256 of a file that is on the disk, with its entry in the folder, when this returns."""
    try:
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
            os.fsync(stream.fileno())
        sync(path.parent)
    except OSError as error:
        raise StudyStorageError(f"the poses in {path} are not on the disk: {error.strerror}") from error
    return digest


def _place(row: AnswerRow) -> str:
    return f"in trial {row.trial} of block {row.block!r}" if row.trial >= 0 else f"of block {row.block!r}"
