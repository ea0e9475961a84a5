# SPDX-License-Identifier: Apache-2.0
"""Change attributes in the text of a URDF and leave every other byte of it as it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import re
from typing import NamedTuple
from xml.parsers import expat

from adaptive_blf_control.errors import ArmError

__all__ = ['Element', 'UrdfText']


class Element(NamedTuple):
    """An element of the text; places are byte offsets.

    Attributes:
        tag: Its name.
        attributes: Its attributes.
        parent: Index of the element around it, −1 for the root.
        start: Of its start tag.
        inside: End of its start tag.
        end: Start of its end tag; not used where the element closes itself.
    """

    tag: str
    attributes: dict[str, str]
    parent: int
    start: int
    inside: int
    end: int


class UrdfText:
    """A URDF as text, with edits that are collected and made at once."""

    def __init__(self, xml: str) -> None:
        """Find the elements of a URDF.

        Raises:
            ArmError: the text is not well-formed XML.
        """
        self._data = xml.encode()
        self.elements: list[Element] = []
        self._open: list[int] = []
        self._edits: list[tuple[int, int, str]] = []
        self._parser = expat.ParserCreate('utf-8')
        self._parser.StartElementHandler = self._begin
        self._parser.EndElementHandler = self._finish
        try:
            self._parser.Parse(self._data, True)
        except expat.ExpatError as error:
            raise ArmError(f'URDF is not well-formed XML: {error}') from None

    def _begin(self, tag: str, attributes: dict[str, str]) -> None:
        start = self._parser.CurrentByteIndex
        parent = self._open[-1] if self._open else -1
        self._open.append(len(self.elements))
        self.elements.append(Element(tag, attributes, parent, start, self._tag_end(start), -1))

    def _finish(self, _: str) -> None:
        index = self._open.pop()
        self.elements[index] = self.elements[index]._replace(end=self._parser.CurrentByteIndex)

    def _tag_end(self, start: int) -> int:
        """Return the end of the tag that starts there; a > may stand in an attribute's value."""
        quote, place = 0, start
        for place in range(start, len(self._data)):
            byte = self._data[place]
            if quote:
                quote = 0 if byte == quote else quote
            elif byte in b'"\'':
                quote = byte
            elif byte == ord('>'):
                break
        return place + 1

    def children(self, parent: int, tag: str) -> list[int]:
        """Return the elements named ``tag`` directly below another, by index."""
        return [index for index, element in enumerate(self.elements)
                if element.parent == parent and element.tag == tag]

    def set_attributes(self, index: int, values: Mapping[str, str]) -> None:
        """Change attributes of an element, or add them."""
        element = self.elements[index]
        tag = self._data[element.start:element.inside].decode()
        for name, value in values.items():
            given = re.search(rf"""\s{re.escape(name)}\s*=\s*("[^"]*"|'[^']*')""", tag)
            if given:
                tag = f'{tag[:given.start(1)]}"{value}"{tag[given.end(1):]}'
            else:
                tag = re.sub(r'\s*(/?>)$', rf' {name}="{value}"\1', tag)
        self._edits.append((element.start, element.inside, tag))

    def replace(self, index: int, line: str) -> None:
        """Put one line of XML in the place of an element."""
        element = self.elements[index]
        end = element.inside
        if self._data[end - 2:end] != b'/>':
            end = self._data.index(b'>', element.end) + 1
        self._edits.append((element.start, end, line))

    def append(self, index: int, lines: Sequence[str]) -> None:
        """Put lines of XML at the end of an element, indented as its other children are."""
        element = self.elements[index]
        indent = self._indent(element.start)
        text = ''.join(f'\n{indent}  {line}' for line in lines)
        if self._data[element.inside - 2:element.inside] != b'/>':
            place = len(self._data[:element.end].rstrip())
            tail = '' if self._data[place:element.end].strip(b' \t') else f'\n{indent}'
            self._edits.append((place, place, text + tail))
            return
        place = len(self._data[:element.inside - 2].rstrip())
        self._edits.append((place, element.inside,
                            f'>{text}\n{indent}</{element.tag}>'))

    def _indent(self, place: int) -> str:
        line = self._data[self._data.rfind(b'\n', 0, place) + 1:place]
        return line[:len(line) - len(line.lstrip())].decode()

    def __str__(self) -> str:
        """Return the text with all edits."""
        data = self._data
        for start, end, text in sorted(self._edits, reverse=True):
            data = data[:start] + text.encode() + data[end:]
        return data.decode()
