# SPDX-License-Identifier: Apache-2.0
"""Facts about edits of a URDF's text."""

from __future__ import annotations

import pytest

from adaptive_blf_control.arms.urdf_text import UrdfText
from adaptive_blf_control.errors import ArmError


def only(text: UrdfText, tag: str) -> int:
    """Return the index of the only element of a name."""
    index, = (i for i, element in enumerate(text.elements) if element.tag == tag)
    return index


@pytest.mark.parametrize(('before', 'after'), [
    ('<a><b x="1"/></a>', '<a><b x="7"/></a>'),
    ("<a><b\n  y='2' x = '1' ></b></a>", '<a><b\n  y=\'2\' x = "7" ></b></a>'),
    ('<a><b max="1" note="1 > 0"/></a>', '<a><b max="1" note="1 > 0" x="7"/></a>'),
    ('<a><b/></a>', '<a><b x="7"/></a>'),
    ('<?xml version="1.0"?>\n<!-- ä --><a>\t<b x="1" /> </a>\n',
     '<?xml version="1.0"?>\n<!-- ä --><a>\t<b x="7" /> </a>\n')])
def test_an_attribute_changes_and_nothing_else(before: str, after: str) -> None:
    text = UrdfText(before)
    text.set_attributes(only(text, 'b'), {'x': '7'})
    assert str(text) == after


@pytest.mark.parametrize(('before', 'after'), [
    ('<a>\n  <b>\n    <c/>\n  </b>\n</a>', '<a>\n  <b>\n    <c/>\n    <d/>\n  </b>\n</a>'),
    ('<a>\n  <b x="1"/>\n</a>', '<a>\n  <b x="1">\n    <d/>\n  </b>\n</a>'),
    ('<a>\n  <b x="/"  />\n</a>', '<a>\n  <b x="/">\n    <d/>\n  </b>\n</a>')])
def test_lines_are_put_at_the_end_of_an_element(before: str, after: str) -> None:
    text = UrdfText(before)
    text.append(only(text, 'b'), ['<d/>'])
    assert str(text) == after


def test_without_edits_every_byte_stays() -> None:
    xml = '<?xml version="1.0"?>\r\n<a  x = "ü">\t<!-- <b/> --></a >\n'
    assert str(UrdfText(xml)) == xml


def test_what_is_not_xml_is_refused() -> None:
    with pytest.raises(ArmError, match='well-formed'):
        UrdfText('<a><b></a>')
