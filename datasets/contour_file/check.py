"""Whether a contour file is whole: each chunk is read, each rule of docs/formats/file-format.md tried."""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError
from ..rigid import NORM_TOLERANCE
from ..storage.digests import RowDigest
from ..storage.durable import FolderLock
from ..storage.hdf5 import FAILURES, Hdf5Reader
from ..storage.schema import (
    CONTOURS,
    HAND,
    KIND_NAMES,
    LIVE,
    LIVE_MARKS,
    METRICS,
    MOTION,
    OBJECT,
    TIMING,
    Arrays,
    Field,
    count_problems,
    shape_problem,
)
from .header import get_header, get_live, get_texts, recipe_differences
from .header_hand import hand_problem
from .header_live import require_live
from .reader import ContourFile
from .timing import get_timing

LENGTH_TOLERANCE = (1e-6, 1e-7)
"""Stored and recomputed lengths agree within this, relative and absolute [m]."""
_BLOCK_ROWS = 1 << 17

Flags = NDArray[np.bool_]


@dataclass
class _Findings:
    """Problems; each kind is reported once, with its count and its first row."""

    sentences: list[str] = field(default_factory=list[str])
    rows: dict[tuple[str, str], list[int]] = field(default_factory=dict[tuple[str, str], list[int]])

    def add(self, sentence: str) -> None:
        self.sentences.append(sentence)

    def tell_rows(self, name: str, problem: str, flags: Flags, first: int) -> None:
        """Note the rows that are flagged, counted from `first`."""
        flagged = np.flatnonzero(flags)
        if flagged.size:
            entry = self.rows.setdefault((name, problem), [int(flagged[0]) + first, 0])
            entry[1] += int(flagged.size)

    def sentences_of_all(self) -> list[str]:
        counted = [f"{name}: {problem} ({n}, first {row})" for (name, problem), (row, n) in self.rows.items()]
        return [*self.sentences, *counted]


def check_file(path: str | PathLike[str]) -> list[str]:
    """Problems of a contour file, a sentence each naming the path inside the file; empty if it is whole.

    Everything is read, in blocks. A file that is still being written, or whose writing was interrupted, is a problem
    by itself; what is done of it is checked all the same. Nothing is raised for a bad file. Motion and mesh are held
    whole, all else in blocks of about a million points.

    >>> import os
    >>> from palpate.render import check_file, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("broken.h5")
    >>> check_file(path)
    []
    >>> os.truncate(path, 1000)
    >>> check_file(path)
    ['broken.h5 is truncated']
    """
    try:
        with ContourFile(path) as file:
            return _check_open(file)
    except ContourFileError as error:
        return [str(error)]
    except FAILURES as error:  # a rule that damage found no words for
        return [f"{path} cannot be checked: {type(error).__name__}: {error}"]


def unproven_content(path: str | PathLike[str]) -> list[str]:
    """Sentences on content that no digest verifies: all content of a file without digests, otherwise none.

    Empty for a file that is not sealed, or cannot be read.
    """
    try:
        with Hdf5Reader(path) as file:
            return [] if file.digests else ["all content, as formats before 1.5 have no such digests"]
    except ContourFileError:
        return []


def _check_open(file: ContourFile) -> list[str]:
    findings = _Findings()
    if not file.sealed:
        done = sum(stop - first for first, stop in file.done)
        held = FolderLock.is_held(file.folder)
        state = "is still being written" if held else 'is not finished, mode="resume" finishes it'
        findings.add(f"{file.path} {state}: {done} of {file.pose_count} poses are done")
    for problem in file.problems:
        findings.add(problem)
    header, parts = file.parts()
    check = _PartCheck(header, findings, "" if file.sealed else f"{header.path.name}: ")
    check.fields(MOTION)
    check.fields(OBJECT)
    check.fields(HAND)
    check.fields(LIVE)
    check.header(header)
    check.proven()
    check.live(header)
    try:
        for part, pose_count in parts:
            check = _PartCheck(part, findings, "" if file.sealed else f"{part.path.name}: ")
            check.fields((*CONTOURS, *METRICS), pose_count)
            check.fields(TIMING)
            if not file.sealed:
                check.proven()
            if "/timing/seconds" in check.shapes:
                get_timing(part)
        if not findings.rows and len(findings.sentences) == int(not file.sealed) + len(file.problems):
            _check_contours(file, findings)  # only fields that are right by themselves can be compared
    except ContourFileError as error:
        findings.add(str(error))
    return findings.sentences_of_all()


@dataclass
class _PartCheck:
    """The fields of one HDF5 file, each by itself; `inside` begins each sentence."""

    part: Hdf5Reader
    findings: _Findings
    inside: str
    shapes: dict[str, tuple[int, ...]] = field(default_factory=dict[str, tuple[int, ...]])

    def header(self, part: Hdf5Reader) -> None:
        """Attributes, and whether recipe and hashes are of what the file holds."""
        try:
            header = get_header(part, with_live=False)
            header.validate()
            stored, found = get_texts(part, "/", "recipe"), header.recipe
            if changed := recipe_differences(stored, {**found, "format": stored.get("format", "absent")}):
                self._report(f"/: recipe is not of what the file holds: {'; '.join(changed)}")
            if part.text("/object", "hash") != header.object_hash:
                self._report("/object: hash is not of vertices and faces")
            if problem := hand_problem(header.hand, header.hand_arrays):
                self._report(problem)
        except ContourFileError as error:
            self.findings.add(str(error))

    def proven(self) -> None:
        """Attributes by their digests, and whether every dataset is there that has a digest."""
        try:
            self.part.require_attributes()
            digests = self.part.digests
            if lost := [path for path in (digests.datasets if digests else ()) if path not in self.part]:
                self._report(f"{lost[0]} is missing, though it has a digest")
        except ContourFileError as error:
            self.findings.add(str(error))

    def live(self, part: Hdf5Reader) -> None:
        """Whether the arrays of a live run are as its description says."""
        try:
            rows = {spec.name: self.shapes[spec.path][0] for spec in LIVE if spec.path in self.shapes}
            require_live(get_live(part), rows, part.layout("/motion/pose")[1][0])
        except ContourFileError as error:
            self.findings.add(str(error))

    def fields(self, fields: tuple[Field, ...], pose_count: int | None = None) -> None:
        """Layout, attributes, checksums and values of fields, and whether their numbers of rows fit each other."""
        present = [spec for spec in fields if not spec.optional or spec.path in self.part]
        for spec in present:
            self._layout(spec)
        rows, problems = count_problems(self.shapes, fields)
        for problem in problems:
            self._report(problem)
        if pose_count is not None and rows.get("pose", pose_count) != pose_count:
            self._report(f"/{fields[0].group} has {rows['pose']} poses, expected {pose_count}")
        for spec in present:
            if spec.path in self.shapes:
                self._values(spec)

    def _layout(self, spec: Field) -> None:
        try:
            dtype, shape = self.part.layout(spec.path)
            if problem := shape_problem(spec, dtype, shape):
                self._report(problem)
                return
            self.shapes[spec.path] = shape
            for key, wanted in (("units", spec.unit), ("frame", spec.frame)):
                got = self.part.attribute(spec.path, key)
                if not isinstance(got, str) or got != wanted:  # an array would be compared number by number
                    self._report(f"{spec.path}: attribute {key} is {got!r}, expected {wanted!r}")
            if not self.part.has_checksum(spec.path):
                self._report(f"{spec.path}: has no Fletcher-32 checksums")
        except ContourFileError as error:
            self.findings.add(str(error))

    def _values(self, spec: Field) -> None:
        """Read all rows, one of them twice where blocks meet so that every step between rows is seen."""
        count = self.shapes[spec.path][0]
        digest, is_read = RowDigest(), True
        for first in range(0, count, _BLOCK_ROWS):
            stop, overlap = min(first + _BLOCK_ROWS, count), int(first > 0)
            try:
                rows = self.part.read(spec.path, first - overlap, stop)
            except ContourFileError as error:
                self.findings.add(f"{error} (rows {first} to {stop})")
                is_read = False
                continue
            digest.add(rows[overlap:])
            for problem, flags in _value_flags(spec, rows):
                self.findings.tell_rows(f"{self.inside}{spec.path}", problem, flags[overlap:], first)
            if spec.is_offset and first == 0 and rows[0] != 0:
                self._report(f"{spec.path}: begins with {rows[0]}, expected 0")
            if spec.is_offset and stop == count:
                self._end(spec, int(rows[-1]))
        try:
            if is_read:
                self.part.require_digest(spec.path, digest)
        except ContourFileError as error:
            self.findings.add(str(error))

    def _end(self, spec: Field, last: int) -> None:
        target = {"pose_start": "/contours/polyline_closed", "polyline_start": "/contours/points"}[spec.name]
        if target in self.shapes and last != self.shapes[target][0]:
            self._report(f"{spec.path}: ends with {last}, but {target} has {self.shapes[target][0]} rows")

    def _report(self, sentence: str) -> None:
        self.findings.add(f"{self.inside}{sentence}")


def _value_flags(spec: Field, rows: NDArray[Any]) -> list[tuple[str, Flags]]:
    """Rules of a field by itself: what is wrong with the rows flagged."""
    flags: list[tuple[str, Flags]] = []
    if rows.dtype.kind == "f" and spec.name not in _MAY_LACK:
        flags.append(("not finite", _any_of_row(~np.isfinite(rows))))
    if spec.name in _RANGE:
        low, high = _RANGE[spec.name]
        name = f"outside {low} to {high}" if high < np.inf else f"below {low}"
        flags.append((name, _any_of_row((rows < low) | (rows > high))))
    if spec.name in _STEP:
        below = np.less if spec.name == "pose_start" else np.less_equal  # only poses may be without content
        flags.append((_STEP[spec.name], np.concatenate([np.zeros(1, np.bool_), below(rows[1:], rows[:-1])])))
    if spec.path == "/motion/pose":
        norm = np.sqrt((rows[:, 3:].astype(np.float64) ** 2).sum(axis=1))
        flags.append((f"quaternion norm not 1 within {NORM_TOLERANCE}", np.abs(norm - 1.0) > NORM_TOLERANCE))
    return flags


_MAY_LACK = ("seconds", "patch_pose", "emitted")
"""Where NaN is right: a stage that a chunk had not, a patch that a pose has not, a pose that was never emitted."""
_RANGE: dict[str, tuple[float, float]] = {
    "kind": (0, len(KIND_NAMES) - 1),
    "intensity": (0, 1),
    "dwell": (0, np.inf),
    "skin_faces": (0, np.inf),
    "skin_glabrous": (0, 1),
    "polyline_closed": (0, 1),
    "polyline_patch": (0, np.inf),
    "faces": (0, np.inf),
    "polylines": (0, np.inf),
    "gain": (0, np.inf),
    "mark": (0, len(LIVE_MARKS) - 1),
    **{spec.name: (0, np.inf) for spec in METRICS},
}
_STEP = {
    "time": "not later than the row before",
    "pose_start": "below the row before",
    "polyline_start": "not above the row before: a polyline without points",
}


def _any_of_row(flags: Flags) -> Flags:
    return np.asarray(flags.reshape(len(flags), -1).any(axis=1), np.bool_)


def _check_contours(file: ContourFile, findings: _Findings) -> None:
    """Rules that tie fields to each other, pose by pose."""
    for first, stop in file.blocks():
        contours, metrics = file.contours(first, stop), file.metrics(first, stop)
        start, end = contours["polyline_start"][:-1], contours["polyline_start"][1:] - 1
        points, kind = contours["points"], contours["kind"]
        pose = np.repeat(np.arange(stop - first), np.diff(contours["pose_start"]))

        def of_poses(polylines: Flags, pose: NDArray[np.int64] = pose, count: int = stop - first) -> Flags:
            return np.bincount(pose[polylines], minlength=count) > 0

        opened = (contours["polyline_closed"] == 1) & (points[start] != points[end]).any(axis=1)
        findings.tell_rows("/contours/polyline_closed", _OPENED, of_poses(opened), first)
        for name in contours.keys() & {"intensity", "dwell"}:
            differs = (contours["polyline_closed"] == 1) & (contours[name][start] != contours[name][end])
            findings.tell_rows(f"/contours/{name}", _SEAM, of_poses(differs), first)
        ending = (end > start) & (kind[end] != kind[np.maximum(end - 1, 0)])
        findings.tell_rows("/contours/kind", _ENDING, of_poses(ending), first)
        counted = metrics["polylines"] != np.diff(contours["pose_start"])
        findings.tell_rows("/metrics/polylines", "poses with another number of polylines", counted, first)
        for name, length in contour_lengths(contours).items():
            relative, absolute = LENGTH_TOLERANCE
            differs = np.abs(metrics[name] - length) > relative * length + absolute
            findings.tell_rows(f"/metrics/{name}", "poses whose points have another length", differs, first)


_OPENED = "poses with a closed polyline that does not repeat its first point"
_SEAM = "poses with a closed polyline whose last point has another value than its first"
_ENDING = "poses with a polyline whose last kind is not that of the point before"


def contour_lengths(contours: Arrays) -> dict[str, NDArray[np.float64]]:
    """Lengths [m] of each pose by name as in /metrics, in all and by kind, float64 [pose], from the points."""
    points = contours["points"].astype(np.float64)
    segment = np.zeros(len(points))
    segment[:-1] = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    segment[contours["polyline_start"][1:] - 1] = 0.0  # from a polyline's end to the next one is no segment
    pose_count = len(contours["pose_start"]) - 1
    pose = np.repeat(np.arange(pose_count), np.diff(contours["polyline_start"][contours["pose_start"]]))
    kinds = {"length": segment} | {
        f"length_{name}": np.where(contours["kind"] == kind, segment, 0.0) for kind, name in enumerate(KIND_NAMES)
    }
    return {
        name: np.asarray(np.bincount(pose, of_kind, minlength=pose_count), np.float64)
        for name, of_kind in kinds.items()
    }
