# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Takes XML apart into plain elements with their lines: bounded, and without entities."""

from __future__ import annotations

import re
from typing import Any
from xml.parsers import expat

from hapticmech_ros.errors import FileError

NODE_LIMIT = 200_000
DEPTH_LIMIT = 200
ATTRIBUTE_LIMIT = 100
# Tag, attributes as written, line where it begins, text in it, and the elements in it.
Element = list[Any]


# A declaration at the start, before which files may have blank lines; what it is, and its encoding.
_DECLARATION = re.compile(r"(?:\xef\xbb\xbf)?(\s*)(<\?xml\s[^<>?]*\?>)")
_ENCODING = re.compile(r"encoding\s*=\s*[\"']([^\"']*)[\"']")
_BLANK = re.compile(r"(?:\xef\xbb\xbf)?\s*<\?\s+xml\s")
_SHOWN = re.compile(r"[^\r\n]")
# What is no markup, and where it ends.
_APART = {"<!--": "-->", "<![CDATA[": "]]>", "<?": "?>"}
_BEGIN = re.compile("|".join(re.escape(one) for one in _APART))


def elements(item: list[Any]) -> Element:
    """Return the outermost element of a text.

    Args:
        item: name of the file; its text, of which a character is a byte; and of the files that
            include it, how many elements they have and in how many of these it is.

    Raises:
        FileError: not XML, too large or too deep; entities are refused.
    """
    file, text, count, depth = item
    above: list[Element] = [["", {}, 0, "", []]]
    texts: list[list[str]] = [[]]
    text, encoding = _as_parsers_take_it(text)
    parser = expat.ParserCreate(encoding)

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        line = parser.CurrentLineNumber
        deep = len(above) + depth
        where = f"line {line}, <{tag}>"
        if count > NODE_LIMIT:
            raise FileError(file, count, f"at most {NODE_LIMIT} elements", where)
        if deep > DEPTH_LIMIT:
            raise FileError(file, deep, f"at most {DEPTH_LIMIT} elements in each other", where)
        if len(attributes) > ATTRIBUTE_LIMIT:
            rule = f"at most {ATTRIBUTE_LIMIT} attributes"
            raise FileError(file, len(attributes), rule, where)
        element = [tag, attributes, line, "", []]
        above[-1][4].append(element)
        above.append(element)
        texts.append([])

    def end(_tag: str) -> None:
        above.pop()[3] = "".join(texts.pop())

    def characters(text: str) -> None:
        texts[-1].append(text)

    def entity(name: str, *_rest: object) -> None:
        raise FileError(file, name, "entities are not read")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = characters
    parser.EntityDeclHandler = entity
    parser.buffer_text = True
    try:
        parser.Parse(text.encode("latin-1"), True)
    except expat.ExpatError as error:
        said, rule = expat.errors.messages[error.code], "not valid XML"
        if _BLANK.match(text):
            rule = (
                "not valid XML: its declaration must begin with <?xml, without a blank before xml"
            )
        raise FileError(file, said, rule, f"line {error.lineno}") from None
    except (ValueError, LookupError) as error:  # an encoding that nobody knows
        raise FileError(file, str(error), "not valid XML") from None
    outermost: Element = above[0][4][0]
    return outermost


def _as_parsers_take_it(text: str) -> tuple[str, str | None]:
    """Return a text in which expat finds what libxml and TinyXML find, lines as they were.

    Comments with two hyphens in them are blank; so is a declaration after blank lines, or one that
    calls UTF-8 ``utf8``. Also return the encoding that such a declaration gave.
    """
    encoding, start = None, _DECLARATION.match(text)
    if start is not None:
        given = _ENCODING.search(start[2])
        named = given[1] if given is not None else ""
        is_alias = named.lower() == "utf8"
        if start[1] or is_alias:
            encoding = "UTF-8" if is_alias else named or None
            text = text[: start.start(2)] + _SHOWN.sub(" ", start[2]) + text[start.end() :]
    parts, at = [], 0
    while (begin := _BEGIN.search(text, at)) is not None:
        ending = _APART[begin[0]]
        inside = begin.end()
        end = text.find(ending, inside)
        if end < 0:
            break
        after = end + len(ending)
        parts.append(text[at : begin.start()])
        part = text[begin.start() : after]
        # The last hyphen of a comment such as <!-- a ---> counts too.
        is_strange = begin[0] == "<!--" and "--" in text[inside : end + 1]
        parts.append(_SHOWN.sub(" ", part) if is_strange else part)
        at = after
    return "".join((*parts, text[at:])), encoding
