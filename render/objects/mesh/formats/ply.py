"""PLY, binary or text: polygons of any number of corners, and triangle strips; other properties are passed over.

Numbers of the text form become float64, so that both forms are read the same way.
"""

import re
import struct
from array import array
from typing import NamedTuple

import numpy as np

from .....datasets.bounded_file import require_bytes
from ....errors import MeshError
from .polygons import FileMesh, numbers_of, plain_text, polygon_triangles, require_corners, shown, strip_triangles

_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float16": "f2",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q", "f8": "d"}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = re.compile(rb"(?:^|[\r\n])end_header[ \t]*(\r\n|\n|\r)")
CORNER_NAMES = ("vertex_indices", "vertex_index")
HEADER_MOST = 1 << 20  # bytes of a header
ROW_BYTES = 48  # that the place of a list takes
CORNER_BYTES = 8  # that a value of a list becomes, int64
FOUND_BYTES = 24  # that finding a value takes among rows of unequal width
EXACT_MOST = 2.0**53  # below it, float64 holds every whole number
POSITION_NAMES = ("x", "y", "z")


class Property(NamedTuple):
    """A value, or a list of values, of each row of an element."""

    name: str
    kind: np.dtype
    """Of a value."""
    count_kind: np.dtype | None
    """Of the number before a list; None for a single value."""


class Element(NamedTuple):
    """A table of rows: vertices, faces, or others."""

    name: str
    row_count: int
    properties: list[Property]


class ListColumn(NamedTuple):
    """The lists of all rows."""

    values: np.ndarray
    """One list after the other."""
    counts: np.ndarray
    """int64, shape [row]."""


Column = np.ndarray | ListColumn


def read_ply(content: bytes) -> FileMesh:
    """The triangles of a PLY file; raises MeshError for one that is cut off, or holds no vertices."""
    elements, order, begin = _header_of(content)
    data = content[begin:]
    if order == "=":
        data = numbers_of(plain_text(data).split(b"\n")).tobytes()
    found: dict[str, dict[str, Column]] = {}
    at = 0
    for element in elements:
        if element.name in found:
            raise MeshError(f"has two elements {element.name}")
        found[element.name], at = _columns_of(data, at, element)
    if at < len(data) and (order == "=" or data[at:].strip()):
        raise MeshError(f"holds {len(data) - at} bytes more than its header names: its header may be wrong")
    return _mesh_of(found)


def _header_of(content: bytes) -> tuple[list[Element], str, int]:
    """Elements, byte order (as NumPy writes it), and where the data begin."""
    end = _END.search(content, 0, HEADER_MOST)
    if not re.match(rb"ply\s*[\r\n]", content) or end is None:
        raise MeshError("is no PLY file: it must begin with a line ply, and its header end with a line end_header")
    begin = end.end()
    if end[1] == b"\r\n" and not content.startswith(b"ply\r\n") and b"\n" not in content[: end.start()]:
        begin -= 1  # lines end with CR alone, and the first byte of the data is 10
    lines = [line.split() for line in content[: end.start() + 1].decode("latin-1").splitlines()]
    order, elements = "", []
    for line in lines:
        if line[:1] == ["format"] and len(line) > 1:
            order = _ORDERS.get(line[1], "")
        elif line[:1] == ["element"] and len(line) == 3 and line[2].isdecimal():
            elements.append(Element(line[1], int(line[2]), []))
        elif line[:1] == ["property"] and elements:
            elements[-1].properties.append(_property_of(line, order))
        elif line[:1] in (["element"], ["property"]):
            raise MeshError(f"the line {shown(' '.join(line).encode())} of its header is not understood")
    if not order:
        raise MeshError(f"its format must be one of {', '.join(_ORDERS)}")
    return elements, order, begin


def _property_of(line: list[str], order: str) -> Property:
    """A property by its line of the header."""
    is_list = line[1:2] == ["list"]
    names = line[2:-1] if is_list else line[1:-1]
    if len(names) != 1 + is_list or not set(names) <= _TYPES.keys():
        raise MeshError(f"the line {shown(' '.join(line).encode())} of its header is not understood")
    kinds = [np.dtype("f8" if order == "=" else order + _TYPES[name]) for name in names]
    if is_list and kinds[0].kind == "f" and order != "=":
        raise MeshError(f"the line {shown(' '.join(line).encode())} of its header counts in fractions")
    return Property(line[-1], kinds[-1], kinds[0] if is_list else None)


def _columns_of(data: bytes, at: int, element: Element) -> tuple[dict[str, Column], int]:
    """The columns of an element whose rows begin at byte `at`, and where they end."""
    if not element.row_count:
        none = ListColumn(np.empty(0), np.empty(0, np.int64))
        return {prop.name: none if prop.count_kind else np.empty(0) for prop in element.properties}, at
    places, width = _first_row(data, at, element)
    if at + width * element.row_count <= len(data):
        columns: dict[str, Column] = {}
        for prop, (place, count) in zip(element.properties, places, strict=True):
            shape, step = (element.row_count, count), (width, prop.kind.itemsize)
            values = np.ndarray(shape, prop.kind, data, place, step)
            if prop.count_kind is None:
                columns[prop.name] = values[:, 0]
                continue
            before = place - prop.count_kind.itemsize
            counts = np.ndarray((element.row_count,), prop.count_kind, data, before, (width,))
            if (counts != count).any():
                break
            columns[prop.name] = ListColumn(values.reshape(-1), np.full(element.row_count, count, np.int64))
        else:  # all rows are as wide as the first: by induction, each count was read where it is
            return columns, at + width * element.row_count
    elif all(prop.count_kind is None for prop in element.properties):
        raise _cut_off(element)
    return _walked(data, at, element)


def _first_row(data: bytes, at: int, element: Element) -> tuple[list[tuple[int, int]], int]:
    """Where the first row has the values of each property, and how many; and the bytes of the row."""
    places, begin = [], at
    for prop in element.properties:
        count = 1
        if prop.count_kind is not None:
            count = _count_at(data, at, prop.count_kind, element)
            at += prop.count_kind.itemsize
        places.append((at, count))
        at += count * prop.kind.itemsize
    return places, at - begin


def _count_at(data: bytes, at: int, kind: np.dtype, element: Element) -> int:
    """The number before a list."""
    if at + kind.itemsize > len(data):
        raise _cut_off(element)
    sign = kind.str[0].replace("|", "<")
    value = struct.unpack_from(sign + _CODES[kind.str[1:]], data, at)[0]
    if not 0 <= value <= len(data) or value != int(value):
        raise MeshError(f"a list of its element {element.name} has {value} values, which cannot be")
    return int(value)


def _walked(data: bytes, at: int, element: Element) -> tuple[dict[str, Column], int]:
    """The columns of rows of unequal width, row by row, and where they end."""
    if element.row_count > len(data):
        raise _cut_off(element)
    require_bytes(ROW_BYTES * len(element.properties) * element.row_count, "what its rows need")
    begins = [array("q") for _ in element.properties]
    counts = [array("q") for _ in element.properties]
    for _ in range(element.row_count):
        places, width = _first_row(data, at, element)
        at += width
        if at > len(data):
            raise _cut_off(element)
        for own_begins, own_counts, (place, count) in zip(begins, counts, places, strict=True):
            own_begins.append(place)
            own_counts.append(count)
    columns: dict[str, Column] = {}
    for prop, own_begins, own_counts in zip(element.properties, begins, counts, strict=True):
        count, begin = np.frombuffer(own_counts, np.int64), np.frombuffer(own_begins, np.int64)
        require_bytes(FOUND_BYTES * int(count.sum()), "what its rows need")
        item = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        from_each_byte = np.ndarray((max(len(data) - prop.kind.itemsize + 1, 0),), prop.kind, data, 0, (1,))
        values = from_each_byte[np.repeat(begin, count) + prop.kind.itemsize * item]
        columns[prop.name] = values if prop.count_kind is None else ListColumn(values, count)
    return columns, at


def _cut_off(element: Element) -> MeshError:
    return MeshError(f"ends before the {element.row_count} rows of its element {element.name}: it may be cut off")


def _mesh_of(found: dict[str, dict[str, Column]]) -> FileMesh:
    """The triangles of all elements that have some."""
    columns = [found.get("vertex", {}).get(name) for name in POSITION_NAMES]
    if any(not isinstance(column, np.ndarray) for column in columns):
        raise MeshError(f"has no element vertex with x, y and z, but {', '.join(found) or 'nothing'}")
    vertices = np.stack([np.asarray(column, np.float64) for column in columns], axis=1)
    faces = [np.empty((0, 3), np.int64)]
    if "face" in found:
        corners, counts = _corners_of(found["face"], "face")
        require_corners(corners, len(vertices))
        faces.append(polygon_triangles(corners, counts, vertices))
    if "tristrips" in found:
        corners, counts = _corners_of(found["tristrips"], "tristrips")
        require_corners(corners[corners != -1], len(vertices), "strips")
        faces.append(strip_triangles(np.insert(corners, np.cumsum(counts), -1)))
    return FileMesh(vertices, np.concatenate(faces))


def _corners_of(columns: dict[str, Column], element: str) -> ListColumn:
    """The lists of vertices of an element: those with a usual name, else the only ones."""
    lists = {name: column for name, column in columns.items() if isinstance(column, ListColumn)}
    name = next((name for name in CORNER_NAMES if name in lists), next(iter(lists), "") if len(lists) == 1 else "")
    if not name:
        raise MeshError(f"its element {element} has no list {' or '.join(CORNER_NAMES)}, but {', '.join(columns)}")
    values = lists[name].values
    require_bytes(CORNER_BYTES * len(values), "what its polygons become")
    if values.dtype.kind == "f" and not ((np.abs(values) < EXACT_MOST) & (values == np.floor(values))).all():
        raise MeshError(f"its element {element} names vertices by other numbers than whole ones")
    return ListColumn(values.astype(np.int64), lists[name].counts)
