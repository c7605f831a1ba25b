"""glTF files that tests write entry by entry, as the specification of glTF 2.0 has them."""

import base64
import json
import struct

import numpy as np
from file_meshes import CUBE, TRIANGLES

KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class GltfFile:
    """A glTF with one buffer, to which arrays are added; everything else is entries of `tree`."""

    def __init__(self, **tree):
        self.content = b""
        self.tree = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
        self.tree |= {"meshes": [], "accessors": [], "bufferViews": []} | tree

    def view(self, content, **entries):
        """A buffer view of bytes; returns its index."""
        self.tree["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.content), "byteLength": len(content), **entries}
        )
        self.content += content + bytes(-len(content) % 4)
        return len(self.tree["bufferViews"]) - 1

    def array(self, values, kind, **entries):
        """An accessor; returns its index."""
        values = np.atleast_1d(np.asarray(values, kind))
        rows = values.reshape(len(values), -1)
        self.tree["accessors"].append(
            {"componentType": KINDS[values.dtype.str[1:]], "count": len(rows), "type": TYPES[rows.shape[1]]}
            | ({} if "bufferView" in entries or "sparse" in entries else {"bufferView": self.view(rows.tobytes())})
            | entries
        )
        return len(self.tree["accessors"]) - 1

    def mesh(self, vertices=CUBE, triangles=TRIANGLES, **primitive):
        """A mesh of one primitive; returns its entry."""
        attributes = {"POSITION": self.array(vertices, "f4")} | primitive.pop("attributes", {})
        entry = {"attributes": attributes, "indices": self.array(np.ravel(triangles), "u2")} | primitive
        self.tree["meshes"].append({"primitives": [entry]})
        return self.tree["meshes"][-1]

    def text(self):
        """The file with its buffer in it."""
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.content).decode()
        buffers = [{"uri": uri, "byteLength": len(self.content)}, *self.tree.get("buffers", [])]
        return json.dumps(self.tree | {"buffers": buffers}).encode()

    def glb(self):
        """The file as GLB."""
        text = json.dumps(self.tree | {"buffers": [{"byteLength": len(self.content)}]}).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(self.content), b"BIN\0") + self.content
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def full_file():
    """A cube that uses what there is: a skin of two joints, morph targets, sparse and normalised arrays, a strip."""
    nodes = [{"mesh": 0, "skin": 0}, {"name": "wrist", "children": [2]}, {"name": "b", "translation": [1, 0, 0]}]
    file = GltfFile(nodes=nodes, scenes=[{"nodes": [0, 1]}])
    inverse = np.stack([np.eye(4), np.eye(4)]).reshape(2, 16)
    file.tree["skins"] = [{"joints": [1, 2], "inverseBindMatrices": file.array(inverse, "f4")}]
    changes = {
        "count": 2,
        "indices": {"bufferView": file.view(np.array([1, 3], "u1").tobytes()), "componentType": 5121},
        "values": {"bufferView": file.view(CUBE[:2].astype("f4").tobytes())},
    }
    target = file.array(CUBE, "f4", sparse=changes)
    attributes = {
        "JOINTS_0": file.array([[0, 1, 0, 0]] * 8, "u1"),
        "WEIGHTS_0": file.array([[51, 204, 0, 0]] * 8, "u1", normalized=True),
    }
    mesh = file.mesh(CUBE * 0.1, attributes=attributes, targets=[{"POSITION": target}])
    mesh["weights"] = [0.1]
    mesh["primitives"].append({**mesh["primitives"][0], "mode": 5})
    return file
