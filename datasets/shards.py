"""The work folder of an unfinished contour file: a header, and one immutable shard for each pose range done.

A shard is a small HDF5 file with the same datasets, offsets from 0. Its name carries its pose range and the CRC-32 of
its bytes, so a damaged one is known without HDF5 ever opening it; its attribute `recipe` tells whose it is.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import ContourFileError
from .hdf5 import Hdf5Image, Hdf5Reader
from .header import json_text
from .schema import CONTOURS, METRICS, TIMING, Field

HEADER_NAME = "header.h5"
_PATTERN = re.compile(r"poses-(\d{12})-(\d{12})-([0-9a-f]{8})\.h5")
_BLOCK_BYTES = 1 << 22


@dataclass(frozen=True)
class Shard:
    """One immutable file with the contours of poses `first` to `stop`."""

    path: Path
    first: int
    stop: int


def work_folder(path: Path) -> Path:
    """Where the parts of a file lie until it is sealed; raises ContourFileError for a path without a name."""
    if not path.name:  # "/", "."
        raise ContourFileError(f"{path} is a folder, not a contour file")
    return path.with_name(path.name + ".partial")


def shard_files(folder: Path) -> list[Shard]:
    """Shards of a folder by their names, in pose order; nothing is opened. Raises OSError where it cannot be listed."""
    found = [(path, _PATTERN.fullmatch(path.name)) for path in folder.iterdir()]
    shards = [Shard(path, int(match[1]), int(match[2])) for path, match in found if match]
    return sorted(shards, key=lambda shard: (shard.first, shard.stop, shard.path.name))


def without_overlap(shards: list[Shard]) -> tuple[list[Shard], list[Shard]]:
    """Shards in pose order that do not overlap, and those left out because they overlap one before or have no poses."""
    kept: list[Shard] = []
    dropped: list[Shard] = []
    for shard in shards:
        fits = shard.stop > shard.first >= (kept[-1].stop if kept else 0)
        (kept if fits else dropped).append(shard)
    return kept, dropped


def shard_name(first: int, stop: int, content: memoryview) -> str:
    """Name of the shard with this content."""
    return f"poses-{first:012d}-{stop:012d}-{zlib.crc32(content):08x}.h5"


def shard_problem(shard: Shard, recipe_hash: str) -> str | None:
    """Why a shard found on the disk cannot be trusted, as a clause; None if it can."""
    match = _PATTERN.fullmatch(shard.path.name)
    try:
        if match is None or _file_crc(shard.path) != int(match[3], 16):
            return "is truncated or damaged"
        with Hdf5Reader(shard.path) as file:
            if file.attribute("/", "recipe") != recipe_hash:
                return "is of another rendering"
            _, shape = file.layout("/contours/pose_start")
    except (OSError, ContourFileError) as error:
        return f"cannot be read ({error})"
    return None if shape == (shard.stop - shard.first + 1,) else "does not hold the poses that its name says"


def shard_image(
    poses: tuple[int, int],
    contours: Mapping[str, NDArray[Any]],
    metrics: Mapping[str, NDArray[Any]],
    timing: Mapping[str, float],
    recipe_hash: str,
) -> memoryview:
    """The bytes of a shard: arrays as the fields of the schema name them, and seconds by stage."""
    first, stop = poses
    seconds = {
        "first": np.array([first], dtype=np.int64),
        "stop": np.array([stop], dtype=np.int64),
        "seconds": np.array([list(timing.values())], dtype=np.float64).reshape(1, -1),
    }
    groups: tuple[tuple[tuple[Field, ...], Mapping[str, NDArray[Any]]], ...] = (
        (CONTOURS, contours),
        (METRICS, metrics),
        (TIMING, seconds),
    )
    size = sum(array.nbytes for _, arrays in groups for array in arrays.values())
    with Hdf5Image(size) as image:
        image.attributes("/", {"recipe": recipe_hash})
        put_stages(image, list(timing))
        for fields, arrays in groups:
            for spec in fields:
                if spec.name in arrays:
                    image.write(spec, arrays[spec.name])
        return image.image()


def put_stages(image: Hdf5Image, stages: list[str]) -> None:
    """Store the names of the columns of /timing/seconds."""
    image.attributes("/timing", {"stages": json_text({"stages": stages}, "timing")})


def _file_crc(path: Path) -> int:
    crc = 0
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK_BYTES):
            crc = zlib.crc32(block, crc)
    return crc
