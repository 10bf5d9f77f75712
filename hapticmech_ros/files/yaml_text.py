# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads YAML that somebody else wrote: in time that grows with its length, into plain values.

LibYAML takes the text apart (PyYAML's own parser does where that was built without it); what
becomes of the pieces is decided here, by the core schema of YAML 1.2 and by limits. A mapping may
merge others (``<<``); each key of these is counted again, as each value that an alias repeats is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

import yaml

from hapticmech_ros.errors import FileError
from hapticmech_ros.files import read_text

# Bytes of a scene.
FILE_SIZE_LIMIT = 4_000_000

# Values with its aliases and merges written out: a short text can alias its way to billions.
VALUE_LIMIT = 200_000
DEPTH_LIMIT = 100
_TOO_DEEP = f"nested too deeply: at most {DEPTH_LIMIT} in each other"
# Characters of a number.
NUMBER_LIMIT = 400

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_WORDS: dict[str, object] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"), float("inf")),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), float("-inf")),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}
_DECIMAL = re.compile(r"[-+]?[0-9]+")
_OTHER_BASE = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_NUMERIC = frozenset("+-.0123456789")
_TAG = "tag:yaml.org,2002:"
_MERGE = object()


@dataclass(slots=True)
class _Open:
    """A list or mapping whose end was not read yet; in a mapping keys and values take turns."""

    anchor: str | None
    value: list[Any] | dict[Any, Any]
    size: int = 1
    key: Any = None
    has_key: bool = False
    merges: list[dict[Any, Any]] = field(default_factory=list)


def document_in(file: str) -> Any:
    """Return what is in a YAML file whose keys are all text, as those of a scene are.

    Raises:
        FileError: cannot be read; see :func:`read_yaml`; or a key is none.
    """
    document = read_yaml(read_text(file, FILE_SIZE_LIMIT), file)
    pending = [document]
    while pending:
        value = pending.pop()
        if isinstance(value, dict):
            for key in value:
                if not isinstance(key, str):
                    raise FileError(file, key, "a key of a scene is text")
            pending += value.values()
        elif isinstance(value, list):
            pending += value
    return document


def read_yaml(text: str, source: str) -> Any:
    """Return the one document of a text as dictionaries, lists, texts, numbers, booleans and None.

    Args:
        text: to read; empty text is None.
        source: what errors name.

    Raises:
        FileError: not YAML, keys or tags that are not read, nested too deeply, or too many values.
    """
    reader = _Reader(source)
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            reader.take(event)
    except yaml.MarkedYAMLError as error:
        # What is missing at the end, LibYAML misses in the line after the last one.
        last = text.rstrip("\n").count("\n")
        mark = error.problem_mark
        where = "file" if mark is None else _line(min(mark.line, last))
        # LibYAML has a limit of its own since PyYAML 6.0.4, and reads ahead.
        rule = _TOO_DEEP if "nesting" in str(error.problem) else "not valid YAML"
        raise FileError(source, error.problem, rule, where) from None
    except (yaml.YAMLError, UnicodeError) as error:  # characters that YAML does not have
        raise FileError(source, str(error), "cannot be read as YAML") from None
    return reader.document


class _Reader:
    """Builds values from events, without recursion."""

    def __init__(self, source: str) -> None:
        self.document: Any = None
        self._source = source
        self._open: list[_Open] = []
        # By anchor: value, and how many values that is.
        self._anchors: dict[str, tuple[Any, int]] = {}
        self._documents = 0
        self._count = 0

    def take(self, event: Any) -> None:
        """Take the next event."""
        handler = _HANDLERS.get(type(event))
        if handler is not None:
            handler(self, event)

    def _begin_document(self, event: Any) -> None:
        self._documents += 1
        if self._documents > 1:
            raise self._error(event, "---", "not valid YAML: one document is expected")

    def _scalar(self, event: Any) -> None:
        value = self._resolved(event)
        if event.anchor is not None:
            self._anchors[event.anchor] = (value, 1)
        self._add(value, 1, 1, event)

    def _alias(self, event: Any) -> None:
        if event.anchor not in self._anchors:
            if any(one.anchor == event.anchor for one in self._open):
                raise self._error(event, event.anchor, "aliases must not hold themselves")
            raise self._error(event, event.anchor, "not valid YAML: alias of nothing")
        value, size = self._anchors[event.anchor]
        self._add(value, size, size, event)

    def _begin(self, event: Any) -> None:
        tag = event.tag
        kind: list[Any] | dict[Any, Any] = {} if type(event) is yaml.MappingStartEvent else []
        if tag not in (None, "!", _TAG + ("map" if isinstance(kind, dict) else "seq")):
            raise self._error(event, tag, "not valid YAML: unknown tag")
        if len(self._open) >= DEPTH_LIMIT:
            raise self._error(event, len(self._open) + 1, _TOO_DEEP)
        if event.anchor is not None:
            self._anchors.pop(event.anchor, None)
        self._open.append(_Open(event.anchor, kind))

    def _end(self, event: Any) -> None:
        done = self._open.pop()
        value = done.value
        if isinstance(value, dict) and done.merges:
            merged: dict[Any, Any] = {}
            for other in done.merges:
                # Of several, the first one's keys count.
                merged = {**other, **merged}
            value = {**merged, **value}
        if done.anchor is not None:
            self._anchors[done.anchor] = (value, done.size)
        self._add(value, done.size, 1, event)

    def _add(self, value: Any, size: int, new: int, event: Any) -> None:
        """Put a value of so many values, some of them not counted yet, where it belongs."""
        self._count += new
        if self._count > VALUE_LIMIT:
            rule = f"at most {VALUE_LIMIT} values with all aliases written out"
            raise self._error(event, self._count, rule)
        if not self._open:
            self.document = value
            return
        around = self._open[-1]
        around.size += size
        if isinstance(around.value, list):
            around.value.append(value)
        elif around.has_key:
            around.has_key = False
            if around.key is _MERGE:
                self._merge(around, value, event)
            else:
                around.value[around.key] = value
        else:
            self._key(around, value, event)

    def _key(self, around: _Open, value: Any, event: Any) -> None:
        if value == "<<" and getattr(event, "implicit", (False,))[0]:
            value = _MERGE
        elif not isinstance(value, Hashable):
            raise self._error(event, value, "not valid YAML: a key is text or a number")
        elif value in around.value:
            raise self._error(event, value, "not valid YAML: duplicate key")
        around.key, around.has_key = value, True

    def _merge(self, around: _Open, value: Any, event: Any) -> None:
        others = value if isinstance(value, list) else [value]
        for other in others:
            if not isinstance(other, dict):
                raise self._error(event, other, "not valid YAML: only mappings can be merged")
            self._count += len(other)
        around.merges += others

    def _resolved(self, event: Any) -> Any:
        """Return what a scalar says."""
        text: str = event.value
        tag = event.tag
        if tag is None and event.implicit[0]:
            return self._plain(text, event)
        if tag in (None, "!", f"{_TAG}str"):
            return text
        if tag in (f"{_TAG}int", f"{_TAG}float", f"{_TAG}bool", f"{_TAG}null"):
            value = self._plain(text, event)
            wanted = tag.removeprefix(_TAG)
            if wanted == "float" and type(value) is int:
                return float(value)
            if type(value).__name__ == {"null": "NoneType"}.get(wanted, wanted):
                return value
        raise self._error(event, f"{tag} {text}", "not valid YAML: unknown tag, or not of its kind")

    def _plain(self, text: str, event: Any) -> Any:
        if text in _WORDS:
            return _WORDS[text]
        if text[0] not in _NUMERIC:
            return text
        number = _number_of(text)
        if number is None:
            return text
        if len(text) > NUMBER_LIMIT:
            rule = f"a number has at most {NUMBER_LIMIT} characters"
            raise self._error(event, text, rule)
        return number(text)

    def _error(self, event: Any, value: object, rule: str) -> FileError:
        return FileError(self._source, value, rule, _line(event.start_mark.line))


_HANDLERS: dict[type, Callable[[_Reader, Any], None]] = {
    yaml.DocumentStartEvent: _Reader._begin_document,
    yaml.ScalarEvent: _Reader._scalar,
    yaml.AliasEvent: _Reader._alias,
    yaml.SequenceStartEvent: _Reader._begin,
    yaml.MappingStartEvent: _Reader._begin,
    yaml.SequenceEndEvent: _Reader._end,
    yaml.MappingEndEvent: _Reader._end,
}


def _number_of(text: str) -> Callable[[str], int | float] | None:
    """Return what makes a number of a text; None if it is none."""
    if _DECIMAL.fullmatch(text):
        return int
    if _OTHER_BASE.fullmatch(text):
        return lambda written: int(written, 0)
    return float if _FLOAT.fullmatch(text) else None


def _line(number: int) -> str:
    return f"line {number + 1}"
