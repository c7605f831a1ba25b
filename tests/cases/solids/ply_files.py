"""PLY files that tests write value by value, in every type and byte order."""

import struct

from file_meshes import CUBE, QUADS

INTEGERS = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "uint8": "B", "int32": "i"}
REALS = {"float": "f", "double": "d", "float32": "f", "float64": "d"}
FORMS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
MIXED = [*QUADS[:5], [3, 0, 4], [3, 4, 7]]


def ply_file(form, elements, newline="\n"):
    """A PLY file. elements: (name, properties, rows); a property is (name, type) or (name, type of count, type)."""
    order, head, body = FORMS[form], ["ply", f"format {form} 1.0", "comment of a test"], []
    codes = INTEGERS | REALS
    for name, properties, rows in elements:
        head.append(f"element {name} {len(rows)}")
        head += [f"property {'list ' * (len(own) == 3)}{' '.join(own[1:])} {own[0]}" for own in properties]
        for row in rows:
            values = []
            for own, value in zip(properties, row, strict=True):
                if len(own) == 3:
                    values.append((codes[own[1]], len(value)))
                values += [(codes[own[-1]], one) for one in (value if len(own) == 3 else [value])]
            if order:
                body.append(b"".join(struct.pack(order + code, value) for code, value in values))
            else:
                body.append((" ".join(repr(value) for _, value in values) + newline).encode())
    return (newline.join([*head, "end_header"]) + newline).encode() + b"".join(body)


def vertex_element(vertices=CUBE, kind="float"):
    return "vertex", [(axis, kind) for axis in "xyz"], [[float(x) for x in row] for row in vertices]


def face_element(polygons, count="uchar", kind="int", name="vertex_indices"):
    return "face", [(name, count, kind)], [[own] for own in polygons]
