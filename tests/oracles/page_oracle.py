"""What an exported page holds, read without any code of palpate: one number after the other, as its codecs are."""

import base64
import json
import struct
import zlib
from html.parser import HTMLParser

import numpy as np


class _Elements(HTMLParser):
    def __init__(self):
        super().__init__()
        self.elements = []
        self.is_open = False

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes), []))
        self.is_open = True

    def handle_endtag(self, tag):
        self.is_open = False

    def handle_data(self, text):
        if self.is_open:
            self.elements[-1][2].append(text)


def elements_of(page):
    """Elements of an HTML page in their order: name, attributes, and the text from its start tag to the next tag."""
    parser = _Elements()
    parser.feed(page)
    parser.close()
    return [(tag, attributes, "".join(texts)) for tag, attributes, texts in parser.elements]


def text_of(page, identifier):
    found = [text for _, attributes, text in elements_of(page) if attributes.get("id") == identifier]
    assert len(found) == 1, identifier
    return found[0]


def read_page(page):
    """The page's JSON, with an array instead of each description of one."""
    content = zlib.decompress(base64.b64decode(text_of(page, "content"), validate=True))
    return decoded(json.loads(text_of(page, "described")), content)


def decoded(described, content):
    if isinstance(described, list):
        return [decoded(each, content) for each in described]
    if not isinstance(described, dict):
        return described
    if "codec" in described:
        return array_of(described, content)
    return {name: decoded(each, content) for name, each in described.items()}


def array_of(described, content):
    shape, at = described["shape"], described["at"]
    count = 1
    for size in shape:
        count *= size
    if described["codec"] != "steps":
        letter = {"f8": "d", "f4": "f", "u4": "I", "u2": "H", "u1": "B"}[described["codec"]]
        return np.array(struct.unpack_from(f"<{count}{letter}", content, at)).reshape(shape)
    rows, columns = shape
    values = np.zeros(shape)
    for column in range(columns):
        number = 0
        for row in range(rows):
            place = column * rows + row
            folded = content[at + place] + 256 * content[at + count + place]
            number += folded // 2 if folded % 2 == 0 else -(folded + 1) // 2
            values[row, column] = described["origin"] + (number % 65536) * described["step"]
    return values
