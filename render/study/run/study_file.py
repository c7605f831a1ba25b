"""A study's data file: made whole, opened strictly, and written by transactions that are on the disk when they end.

A power cut decides how it is written. SQLite's rollback journal is truncated at the end of a transaction, and with
`synchronous=FULL` that is synced as well: the transaction is on the disk when the call returns. If the journal were
removed instead, its entry could come back with the power, and SQLite would undo an answer that was reported as saved.
A write-ahead log would keep answers in a second file until they are copied over: who copies `answers.sqlite` alone
would lose them, and it works on no network file system.
"""

import contextlib
import json
import sqlite3
import threading
from collections.abc import Generator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from ....datasets.bounded_file import FileBoundError
from ....datasets.storage.durable import NewFile, sync
from ....datasets.storage.sqlite_opening import open_database
from ...errors import StudyError, StudyStorageError
from ..plan.study_plan import Answer

FORMAT_VERSION = 1
"""Of the tables; in the file's header (user_version)."""
APPLICATION_ID = 0x70737475
"""In the file's header: `pstu`."""

ABOUT_CONSENT = ("before", -1, "consent")
"""Block, trial and name of the answer 1 that a participant gives who agrees to take part."""


@dataclass(frozen=True, kw_only=True)
class SessionSetup:
    """What one process plays a participant's trials with."""

    array: str = ""
    """Board and port."""
    source: str = ""
    """Where the poses of the hand come from."""
    hand: str = ""
    """What touches: "palm", "planes", "mesh"."""
    lead: float | None = None
    """How far ahead frames are drawn and written [s]."""
    realtime: bool | None = None
    """Whether the system gave the writer a real-time priority."""
    update_rate: float | None = None
    """Of the focal points [Hz]."""


@dataclass(frozen=True, kw_only=True)
class IntervalRow:
    """One stimulus that was played, or was stopped; times [s] are those of CLOCK_MONOTONIC."""

    block: str
    block_position: int
    """Place of the block in this participant's order, from 0."""
    trial: int
    """Of the block, from 0, practice included."""
    attempt: int
    """0; 1 where the trial is played again; and so on."""
    interval: int
    """Of the trial, from 0."""
    stimulus: str
    is_practice: bool
    file: str | None = None
    """Name of the stimulus' file; None: it was rendered live."""
    file_sha256: str | None = None
    poses_file: str | None = None
    """Name, in the folder `poses`, of the contour file with the hand's poses; its SHA-256 is added by the store."""
    onset_planned: float | None = None
    onset: float | None = None
    """Of its first focal point; None: none was played."""
    is_estimate: bool | None = None
    """Whether the onset is computed from the writer's clock, because the array reports none."""
    latency: float | None = None
    """From the call that began the stimulus until its onset [s]."""
    ended: float | None = None
    """When the array was silent again."""
    seconds: float | None = None
    """How long it was played [s]."""
    outcome: str
    """"played", or "stopped before it began" or "stopped after 1.234 s", and the reason where an error ended it."""
    poses: int | None = None
    """Poses of the hand that were drawn."""
    pose_latency_p50: float | None = None
    """Median time from a pose until its focal points are played [s]."""
    pose_latency_p99: float | None = None
    """Time that 99 % of the poses took at most [s]."""
    driven: float | None = None
    """Seconds at full drive of all transducers that it amounts to at most [s]."""
    dropped: int | None = None
    """Focal points that were not played as drawn."""
    length_mean: float | None = None
    """Of the contours, over all poses, those without contours included [m]."""
    r: float | None = None
    """Of a stimulus with closed contours: their length by that of the open ones (OC) of the same poses."""
    r_open: float | None = None
    """The same ratio, a palm wholly inside the object counted as nothing."""


@dataclass(frozen=True, kw_only=True)
class AnswerRow:
    """What a participant has answered to one question."""

    block: str
    """Its name; "before" and "after" for the questions around all blocks."""
    block_position: int
    """Place of the block in this participant's order, from 0; -1: around all blocks."""
    design: str
    """Of the block; empty around all blocks."""
    trial: int
    """Of the block, from 0, practice included; -1: asked after the block, or around all blocks."""
    attempt: int
    """Of the trial, whose intervals the answer is about."""
    name: str
    """Of the question."""
    question: str
    """The text that was read."""
    kind: str
    """"choice", "scale", "number" or "text"."""
    value: Answer
    label: str = ""
    """Of a choice: the text of the option."""
    key: str = ""
    """That was pressed, as browsers name it."""
    key_order: tuple[int, ...] = ()
    """Of a choice: number of the option that each key gives, in the order of the keys."""
    stimuli: tuple[str, ...] = ()
    """Of the trial, in the order of its intervals."""
    is_practice: bool = False
    track: int = 0
    level: int | None = None
    comparison: int | None = None
    """Of constant stimuli and staircases with a standard: the interval, from 0, of the stimulus that is not it."""
    clipped: int = 0
    """Of a staircase: moves so far that would have gone beyond its levels."""
    seconds: float | None = None
    """Reaction time, from when the screen was shown until the key went down [s]."""


@dataclass(frozen=True, kw_only=True)
class ParticipantProgress:
    """How far a participant is: what is stored is not asked again."""

    code: str
    number: int
    """Place of the code in the plan, from 0."""
    session: int
    """Of the process that has just begun."""
    answers: dict[tuple[str, int, str], AnswerRow] = field(default_factory=dict, repr=False)
    """By block, trial and name of the question, in the order in which they were given."""
    attempts: dict[tuple[str, int], int] = field(default_factory=dict, repr=False)
    """Number of the next attempt, by block and trial, of trials with an interval that was played or stopped."""

    @property
    def consented(self) -> bool:
        """Whether the participant has agreed to take part."""
        own = self.answers.get(ABOUT_CONSENT)
        return own is not None and own.value == 1

    def next_attempt(self, block: str, trial: int) -> int:
        """0 for a trial of which nothing was played, else one more than its last attempt."""
        return self.attempts.get((block, trial), 0)


SCHEMA = """
CREATE TABLE study (
    title TEXT NOT NULL, consent TEXT NOT NULL, data_statement TEXT NOT NULL, palpate TEXT NOT NULL,
    made TEXT NOT NULL, sequence INTEGER NOT NULL
);
CREATE TABLE plans (
    sha256 TEXT PRIMARY KEY, text TEXT NOT NULL, codes TEXT NOT NULL, content TEXT NOT NULL, since TEXT NOT NULL
);
CREATE TABLE stimuli (
    name TEXT PRIMARY KEY, sha256 TEXT, value REAL, since TEXT NOT NULL
);
CREATE TABLE participants (
    code TEXT PRIMARY KEY, number INTEGER NOT NULL, began TEXT NOT NULL, finished TEXT
);
CREATE TABLE sessions (
    id INTEGER PRIMARY KEY AUTOINCREMENT, code TEXT NOT NULL REFERENCES participants ON DELETE CASCADE,
    began TEXT NOT NULL, monotonic REAL NOT NULL, machine TEXT NOT NULL, python TEXT NOT NULL, palpate TEXT NOT NULL,
    plan_sha256 TEXT NOT NULL REFERENCES plans, array TEXT NOT NULL, source TEXT NOT NULL, hand TEXT NOT NULL,
    lead REAL, realtime INTEGER, update_rate REAL, numpy TEXT NOT NULL, boot TEXT NOT NULL
);
CREATE TABLE intervals (
    sequence INTEGER PRIMARY KEY, session INTEGER NOT NULL REFERENCES sessions ON DELETE CASCADE,
    code TEXT NOT NULL REFERENCES participants ON DELETE CASCADE, block TEXT NOT NULL, block_position INTEGER NOT NULL,
    trial INTEGER NOT NULL, attempt INTEGER NOT NULL, interval INTEGER NOT NULL, stimulus TEXT NOT NULL,
    is_practice INTEGER NOT NULL, file TEXT, file_sha256 TEXT, poses_file TEXT, poses_sha256 TEXT, onset_planned REAL,
    onset REAL, is_estimate INTEGER, latency REAL, ended REAL, seconds REAL, outcome TEXT NOT NULL, poses INTEGER,
    pose_latency_p50 REAL, pose_latency_p99 REAL, driven REAL, dropped INTEGER, length_mean REAL, r REAL, r_open REAL,
    began TEXT, recorded TEXT NOT NULL, monotonic REAL NOT NULL,
    UNIQUE (code, block, trial, attempt, interval)
);
CREATE TABLE answers (
    sequence INTEGER PRIMARY KEY, session INTEGER NOT NULL REFERENCES sessions ON DELETE CASCADE,
    code TEXT NOT NULL REFERENCES participants ON DELETE CASCADE, block TEXT NOT NULL, block_position INTEGER NOT NULL,
    design TEXT NOT NULL, trial INTEGER NOT NULL, attempt INTEGER NOT NULL, name TEXT NOT NULL, question TEXT NOT NULL,
    kind TEXT NOT NULL, value, label TEXT NOT NULL, key TEXT NOT NULL, key_order TEXT NOT NULL, stimuli TEXT NOT NULL,
    is_practice INTEGER NOT NULL, track INTEGER NOT NULL, level INTEGER,
    comparison INTEGER, clipped INTEGER NOT NULL, seconds REAL,
    answered TEXT NOT NULL, monotonic REAL NOT NULL,
    UNIQUE (code, block, trial, name)
);
CREATE TABLE events (
    sequence INTEGER PRIMARY KEY, session INTEGER NOT NULL REFERENCES sessions ON DELETE CASCADE,
    code TEXT NOT NULL REFERENCES participants ON DELETE CASCADE, name TEXT NOT NULL, details TEXT NOT NULL,
    recorded TEXT NOT NULL, monotonic REAL NOT NULL
);
CREATE VIEW tidy_answers AS
SELECT code, (SELECT number FROM participants WHERE participants.code = answers.code) AS participant,
    block, block_position, design, trial, attempt, name, kind,
    CASE WHEN typeof(value) IN ('integer', 'real') THEN CAST(value AS REAL) END AS number,
    CASE WHEN typeof(value) = 'text' THEN value END AS text,
    label, CASE WHEN design IN ('2ifc', 'constant', 'staircase') AND kind = 'choice' AND json_array_length(stimuli) > 1
        THEN json_extract(stimuli, '$[' || value || ']') END AS chosen,
    json_extract(stimuli, '$[0]') AS first, json_extract(stimuli, '$[1]') AS second,
    is_practice, track, level, comparison, clipped, seconds, sequence
FROM answers ORDER BY sequence;
"""
"""The column `value` has no type, so that SQLite keeps numbers as numbers and texts as texts."""

LISTS = frozenset(own.name for own in fields(AnswerRow) if str(own.type).startswith("tuple"))
"""Fields of an answer that are stored as JSON."""


def columns_of(row: IntervalRow | AnswerRow) -> dict[str, Any]:
    """A row's values by column, as SQLite takes them."""
    return {own.name: storable(getattr(row, own.name)) for own in fields(row)}


def storable(value: Any) -> Any:
    """A value that SQLite keeps.

    A scalar of NumPy becomes Python's, a list JSON, a whole number beyond 64 bits a float. Characters that no text may
    hold (zero bytes, and halves of surrogate pairs, which browsers can send) become the sign for an unknown one.
    """
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, list | tuple):
        return json.dumps([storable(own) for own in value], ensure_ascii=False)
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        return float(value)
    if isinstance(value, str):
        return value.replace("\0", "\ufffd").encode("utf-16", "surrogatepass").decode("utf-16", "replace")
    return value


def json_text(values: dict[str, Any]) -> str:
    """Values as JSON that SQLite and R read: what is no finite number is null, what JSON does not know is text."""
    text = json.dumps(values, default=lambda own: own.item() if hasattr(own, "item") else str(own))
    return json.dumps(json.loads(text, parse_constant=lambda _: None))


NAME = "answers.sqlite"
BUSY_SECONDS = 20.0
"""How long a write waits for another process's transaction, which takes milliseconds."""

_WAY_OUT = "; move it away and put a copy of it in its place, or name another folder"


class StudyFile:
    """The connection to a study's data file; threads may share it. Every error is a StudyError that names the file."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
        self.lock = threading.RLock()
        """Held by a thread that reads or writes."""
        self._connection: sqlite3.Connection | None = None
        self._is_closed = False
        try:
            _make_folder(folder)
            if not self.path.exists():
                self._make()
        except (OSError, sqlite3.Error) as error:
            raise StudyError(f"{self.path} cannot be made: {_reason(error)}") from error
        try:
            with self.lock:
                self._judge(self._connected())
        except (OSError, sqlite3.Error) as error:
            self.close()
            raise StudyError(f"{self.path} cannot be opened: {_reason(error)}") from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close it; closing twice does nothing."""
        with self.lock:
            self._is_closed = True
            self._disconnect()

    def rows(self, statement: str, values: Sequence[Any] = ()) -> list[sqlite3.Row]:
        """The rows of a statement that reads, all read, so that no lock stays."""
        with self.lock:
            try:
                return self._connected().execute(statement, values).fetchall()
            except (OSError, sqlite3.Error) as error:
                self._disconnect()
                raise file_error(self.path, error) from error

    @contextmanager
    def transaction(self, what: str) -> Generator[sqlite3.Connection, None, None]:
        """All within is on the disk when this ends, or nothing of it is there; nobody else writes meanwhile.

        what: subject of the sentence "... is not saved".

        Raises:
            StudyError: It could not be written. What was saved before is there, and the same may be tried again.
            sqlite3.IntegrityError: A row of the kind is there already.
        """
        with self.lock:
            try:
                connection = self._connected()
                connection.execute("BEGIN IMMEDIATE")
                yield connection
                connection.execute("COMMIT")
            except BaseException as error:
                # A disk that was taken away, or a file that was replaced, may be back: the next call opens the file
                # again, and SQLite undoes what lies in its journal.
                with contextlib.suppress(sqlite3.Error):
                    if self._connection is not None and self._connection.in_transaction:
                        self._connection.execute("ROLLBACK")
                self._disconnect()
                if isinstance(error, sqlite3.IntegrityError) or not isinstance(error, OSError | sqlite3.Error):
                    raise
                raise StudyStorageError(
                    f"{what} is not saved: {self.path} cannot be written ({_reason(error)}). Everything that was saved "
                    "before is there. Put this right, then go on"
                ) from error

    def _connected(self) -> sqlite3.Connection:
        if self._is_closed:
            raise StudyError(f"{self.path} is closed")
        if self._connection is None:
            connection = open_database(self.path, writes=True, busy_seconds=BUSY_SECONDS)
            connection.row_factory = sqlite3.Row
            try:
                for pragma in (
                    "journal_mode=TRUNCATE",
                    "synchronous=FULL",
                    "foreign_keys=ON",
                    "secure_delete=ON",  # what a participant withdraws does not stay in free pages
                    "trusted_schema=OFF",
                    "cell_size_check=ON",
                ):
                    connection.execute(f"PRAGMA {pragma}")
            except BaseException:
                connection.close()
                raise
            self._connection = connection
        return self._connection

    def _disconnect(self) -> None:
        if self._connection is not None:
            with contextlib.suppress(sqlite3.Error):
                self._connection.close()
            self._connection = None

    def _make(self) -> None:
        """Make the file under another name, then publish it: it is never there without its tables."""
        with NewFile(self.path) as new:
            with closing(sqlite3.connect(new.temporary, isolation_level=None)) as connection:
                connection.executescript(
                    f"PRAGMA journal_mode=MEMORY; PRAGMA synchronous=FULL; BEGIN; {SCHEMA}"
                    f"PRAGMA application_id={APPLICATION_ID}; PRAGMA user_version={FORMAT_VERSION}; COMMIT"
                )
            with contextlib.suppress(FileExistsError):  # another process was first
                new.publish(replaces=False)

    def _judge(self, connection: sqlite3.Connection) -> None:
        """Refuse what is no study's data, a newer format, and a damaged file."""
        application, version = (
            int(connection.execute(f"PRAGMA {name}").fetchone()[0]) for name in ("application_id", "user_version")
        )
        if application != APPLICATION_ID:
            what = "is empty" if self.path.stat().st_size == 0 else "holds no data of a palpate study"
            raise StudyError(f"{self.path} {what}: move it away, or name another folder")
        if version > FORMAT_VERSION:
            raise StudyError(
                f"{self.path} has format version {version}, this palpate knows up to {FORMAT_VERSION}: a newer one "
                "made it; update palpate"
            )
        with closing(sqlite3.connect(":memory:")) as example:
            example.executescript(SCHEMA)
            lacking = _entries(example) - _entries(connection)
        if lacking or version < 1:
            name = min((own[1] for own in lacking), default="its version")
            raise StudyError(f"{self.path} is damaged: {name!r} is not as palpate made it{_WAY_OUT}")
        triggers = [own[1] for own in _entries(connection) if own[0] == "trigger"]
        if triggers:
            raise StudyError(f"{self.path} has a trigger, {min(triggers)!r:.80}, which could change answers: remove it")
        found = [own[0] for own in connection.execute("PRAGMA integrity_check(1)")]
        if found != ["ok"]:
            fault = " ".join(str(found[0]).replace("*** in database main ***", "").split())
            raise StudyError(f"{self.path} is damaged: {fault}{_WAY_OUT}")


def _make_folder(folder: Path) -> None:
    """Make a folder whose entry, and whose parents' entries, survive a power cut."""
    if not folder.is_dir():
        _make_folder(folder.parent)
        folder.mkdir(exist_ok=True)
        sync(folder.parent)


def _entries(connection: sqlite3.Connection) -> set[tuple[str, str, str]]:
    """Type, name and definition of tables, indexes, views and triggers, whatever spaces they have."""
    rows = connection.execute("SELECT type, name, coalesce(sql, '') FROM sqlite_master")
    return {(str(own[0]), str(own[1]), " ".join(str(own[2]).split())) for own in rows}


def file_error(path: Path, error: OSError | sqlite3.Error | FileBoundError) -> StudyError:
    """The error of a data file that cannot be read."""
    return StudyError(f"{path} cannot be read: {_reason(error)}")


def _reason(error: OSError | sqlite3.Error) -> str:
    """The system's or SQLite's reason, in a user's words."""
    if isinstance(error, FileBoundError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror or error)
    code, text = str(getattr(error, "sqlite_errorname", "")), str(error)
    if code.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB")) or "Could not decode" in text:
        return f"it is damaged ({text}){_WAY_OUT}"
    if code.startswith("SQLITE_BUSY"):
        return f"another program has read or written it for {BUSY_SECONDS:.0f} s: close that program"
    if code.startswith("SQLITE_FULL"):
        return "the disk is full: free space"
    if code == "SQLITE_READONLY_DBMOVED":
        return "it was moved, removed or replaced while it was open: put it back"
    if code.startswith(("SQLITE_READONLY", "SQLITE_PERM")):
        return "no permission"
    if code.startswith("SQLITE_CANTOPEN"):
        return "it was removed, or there is no permission"
    if code.startswith("SQLITE_IOERR"):
        return f"{text}: the disk or a quota may be full, so free space"
    return text
