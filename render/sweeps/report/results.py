"""What a sweep leaves in its store beside results: the table, one row a recipe, rows of poses, and a figure.

They are written anew whenever the plan, the code or what has been made differ from when they were
written; table.json records that.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ....datasets.errors import SweepStoreError
from ....datasets.json_text import read_json
from ....datasets.storage.durable import FolderLock, discard, discard_tree, write_file
from ....datasets.storage.schema import PRUNED_NAMES, removed_name
from ....datasets.sweeps.pose_files import POSES, write_pose_files
from ....datasets.sweeps.store import SweepStore, is_read_only
from ...errors import RenderError, SweepError
from ...terminal import console
from ..plan.code_version import code_version, files_digest

if TYPE_CHECKING:
    from ..plan.loading import Plan

TABLE, FIGURE, STAMP = "table.h5", "summary.png", "table.json"
POSES_BEFORE = "poses.h5"  # of an earlier palpate
LENGTHS = ("length", *(f"length_{kind}" for kind in ("object", "hand", "made", "intensity")))
REMOVED = tuple(map(removed_name, PRUNED_NAMES))
FREQUENCIES = ("draw_frequency_nominal", "draw_frequency_actual")
POSE_UNITS = dict.fromkeys((*LENGTHS, *REMOVED), "m") | dict.fromkeys(FREQUENCIES, "Hz") | {"area": "m2"}
WRITING = ("render/sweeps/report/*.py", "datasets/sweeps/*.py")  # code that decides tables and pictures
NAMED_MOST = 3  # recipes without contact that a warning names
LOCK_SECONDS = 60.0  # for another parent that writes the same store's table


class Results:
    """Table and figure of a run, in its store; written unless they are there already."""

    def __init__(self, plan: Plan, folder: Path, *, is_complete: bool, has_news: bool) -> None:
        """is_complete: whether every recipe could be made; has_news: whether any part was made just now."""
        self._plan, self._folder, self._is_complete = plan, folder, is_complete
        self._columns: dict[str, Any] = {}
        with SweepStore(folder, code_version()) as store:
            self._made_by = store.code
            """Other code versions whose results count."""
        self._stamp = {"plan": plan.described()["digest"], "maker": self._made_by, "code": files_digest(WRITING)}
        self._attributes = {"plan": plan.described(), "name": plan.name, "maker": self._made_by}
        self._is_fresh = is_complete and not has_news and _stamped(folder) == self._stamp | self._sizes()
        self._is_fresh = self._is_fresh and _is_whole(folder / TABLE)
        self.files = {"table": str(folder / TABLE)}
        """By what they are."""

    @property
    def columns(self) -> dict[str, Any]:
        """Of the table, read when first asked for."""
        if not self._columns and self._is_fresh:
            from ....datasets.sweeps.table import load_table

            self._columns = dict(load_table(self._folder / TABLE, constants=True))
        elif not self._columns:
            from .table import tidy_columns

            with SweepStore(self._folder, code_version()) as store:
                self._columns = tidy_columns(self._plan.recipes(), store, self._plan.groups)
        return self._columns

    def write(self, tables: Sequence[Path], *, figure: bool) -> None:
        """Write what is not there, and the table into `tables` too. figure: draw one, too."""
        picture = self._folder / FIGURE
        cannot_write = is_read_only(self._folder)
        if cannot_write and not self._is_fresh:
            del self.files["table"]
            console.warn(f"{self._folder} cannot be written, and its own table is of another plan: see --table")
        elif not cannot_write and (not self._is_fresh or (figure and _size(picture) <= 0)):
            with locked(self._folder):
                if not self._is_fresh:
                    self._write_store_table()
                    discard(picture)  # of other results
                if figure:
                    _draw(picture, self.columns, self._plan)
        for path in tables:
            _write_table(path, self.columns, self._attributes)
        if "poses" in self._plan.groups and "table" in self.files:
            self.files["poses_table"] = str(self._folder / POSES)
        if picture.exists() and "table" in self.files:
            self.files["figure"] = str(picture)

    def _write_store_table(self) -> None:
        discard(self._folder / STAMP)
        _write_table(self._folder / TABLE, self.columns, self._attributes)
        if (text := contactless_text(self.columns)) is not None:
            console.warn(text)
        self._write_poses()
        if self._is_complete:
            content = json.dumps(self._stamp | self._sizes())
            with contextlib.suppress(OSError):  # without the stamp the table is written again
                write_file(self._folder / STAMP, content.encode())

    def _write_poses(self) -> None:
        """Write one row per pose if the plan asks for it; an earlier plan's rows would be of another table."""
        discard(self._folder / POSES_BEFORE)
        if "poses" not in self._plan.groups:
            discard_tree(self._folder / POSES)
            return
        from .table import pose_blocks

        with SweepStore(self._folder, code_version()) as store:
            blocks = pose_blocks(self._plan.recipes(), store)
            write_pose_files(self._folder / POSES, blocks, self._attributes, units=POSE_UNITS)

    def _sizes(self) -> dict[str, Any]:
        """Of its tables [byte]: one that was deleted or cut is written again."""
        poses = sorted((self._folder / POSES).glob("*"))
        return {"bytes": {path.name: _size(path) for path in (self._folder / TABLE, *poses)}}


def contactless_text(columns: Mapping[str, Sequence[Any]]) -> str | None:
    """A sentence on recipes whose hand never meets the object, as ratios and frequencies of these are NaN; or None."""
    from .compare import row_names

    lengths = columns.get("length_mean", ())
    empty = [row for row, length in enumerate(lengths) if length == 0]
    if not empty:
        return None
    names = row_names(columns)
    listed = "; ".join(names[row] for row in empty[:NAMED_MOST])
    listed += f"; and {len(empty) - NAMED_MOST:,} more" if len(empty) > NAMED_MOST else ""
    return (
        f"in {len(empty):,} of {len(lengths):,} recipes the hand never meets the object, so their length is 0, and "
        f"r, draw frequencies and predictions are empty (NaN): {listed}. object.at moves an object to the hand, "
        "motion.alignment a recording from its tracker's frame to the array's"
    )


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Sole right to write a store's table and figure, waited for while another parent has it."""
    until = time.monotonic() + LOCK_SECONDS
    while True:
        try:
            lock = FolderLock(folder)
            break
        except BlockingIOError:
            if time.monotonic() > until:
                raise SweepError(f"{folder}: another process has been writing its table for a minute") from None
            time.sleep(0.05)
        except OSError as error:
            raise SweepError(f"{folder}: its table cannot be written ({error.strerror or error})") from error
    try:
        yield
    finally:
        lock.release()


def _write_table(path: Path, columns: dict[str, Any], attributes: dict[str, Any]) -> None:
    from ....datasets.sweeps.table import write_parquet, write_table
    from .table import column_units, constant_attributes, split_constants

    write = write_parquet if path.suffix == ".parquet" else write_table
    varying, constants = split_constants(columns)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SweepError(f"{path.parent} cannot be made: {error.strerror or error}") from error
    write(path, varying, attributes | constant_attributes(constants), units=column_units(varying))


def _draw(figure: Path, columns: dict[str, Any], plan: Plan) -> None:
    """Where nothing can be drawn, a warning says why: results are worth more than their picture."""
    from .figure import draw_sweep  # matplotlib

    try:
        draw_sweep(columns, figure, name=plan.name)
    except (RenderError, OSError) as error:
        _warn_no_figure(str(error))
    except Exception as error:  # matplotlib's, of names or numbers that nobody thought of
        _warn_no_figure(f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}")


def _warn_no_figure(why: str) -> None:
    console.warn(f"no figure: {why}")


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return -1


def _is_whole(table: Path) -> bool:
    """Whether a table has its digest; a damaged one causes a warning, and is written again."""
    from ....datasets.sweeps.table import table_attributes

    try:
        table_attributes(table)
    except SweepStoreError as error:
        console.warn(f"{error}; it is written again")
        return False
    return True


def _stamped(folder: Path) -> dict[str, Any] | None:
    """What the store's table was made of."""
    try:
        return read_json(folder / STAMP)
    except (OSError, ValueError):
        return None
