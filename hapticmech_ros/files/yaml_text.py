# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads untrusted YAML in time that grows with its length, into plain values.

LibYAML parses the text (or PyYAML's own parser, if built without it); this module converts its
events, by the core schema of YAML 1.2 and by limits. A mapping may merge others (``<<``); each key
of these is counted again, as each value that an alias repeats is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable
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
# Forms of numbers, and what reads them.
_NUMBERS: tuple[tuple[re.Pattern[str], Callable[[str], int | float]], ...] = (
    (re.compile(r"[-+]?[0-9]+"), int),
    (re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+"), lambda text: int(text, 0)),
    (re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"), float),
)
_NUMERIC = frozenset("+-.0123456789")
_TAG = "tag:yaml.org,2002:"


def document_in(file: str) -> Any:
    """Return the document in a YAML file whose keys are all text, as a scene's.

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
        source: named in errors.

    Raises:
        FileError: not YAML, keys or tags that are not read, nested too deeply, or too many values.
    """
    try:
        return _Reader(text, source).document()
    except yaml.MarkedYAMLError as error:
        # LibYAML reports something missing at the end in the line after the last one.
        last = text.rstrip("\n").count("\n")
        mark = error.problem_mark
        where = "file" if mark is None else _line(min(mark.line, last))
        # LibYAML has a limit of its own since PyYAML 6.0.4, and reads ahead.
        rule = _TOO_DEEP if "nesting" in str(error.problem) else "not valid YAML"
        raise FileError(source, error.problem, rule, where) from None
    except (yaml.YAMLError, UnicodeError) as error:  # characters that YAML does not have
        raise FileError(source, str(error), "cannot be read as YAML") from None


class _Reader:
    """Builds values from events; as deep as they may be nested, so deep it calls itself."""

    def __init__(self, text: str, source: str) -> None:
        self._events = yaml.parse(text, Loader=_LOADER)
        self._source = source
        # By anchor: value, and how many values that is; none while it is being read.
        self._anchors: dict[str | None, tuple[Any, int]] = {}
        self._count = 0

    def document(self) -> Any:
        """Return the one document."""
        found, documents = None, 0
        for event in self._events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise self._error(event, "---", "not valid YAML: one document is expected")
            elif isinstance(event, yaml.NodeEvent):
                found, _ = self._value(event, 0)
        return found

    def _value(self, event: Any, depth: int) -> tuple[Any, int]:
        """Return the value that begins with an event, and how many values that is."""
        size = 1
        if isinstance(event, yaml.AliasEvent):
            value, size = self._alias(event)
            self._add_to_count(size, event)
            return value, size
        if isinstance(event, yaml.ScalarEvent):
            value = self._resolved(event)
        else:
            self._anchors[event.anchor] = (None, 0)
            value, size = self._collection(event, depth)
        self._anchors[event.anchor] = (value, size)
        self._add_to_count(1, event)
        return value, size

    def _alias(self, event: Any) -> tuple[Any, int]:
        value, size = self._anchors.get(event.anchor, (None, 0))
        if not size:
            is_open = event.anchor in self._anchors
            rule = (
                "aliases must not hold themselves"
                if is_open
                else "not valid YAML: alias of nothing"
            )
            raise self._error(event, event.anchor, rule)
        return value, size

    def _collection(self, event: Any, depth: int) -> tuple[list[Any] | dict[Any, Any], int]:
        is_list = isinstance(event, yaml.SequenceStartEvent)
        if event.tag not in (None, "!", _TAG + ("seq" if is_list else "map")):
            raise self._error(event, event.tag, "not valid YAML: unknown tag")
        if depth >= DEPTH_LIMIT:
            raise self._error(event, depth + 1, _TOO_DEEP)
        return self._list(depth + 1) if is_list else self._mapping(depth + 1)

    def _list(self, depth: int) -> tuple[list[Any], int]:
        found, size = [], 1
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            value, inside = self._value(event, depth)
            found.append(value)
            size += inside
        return found, size

    def _mapping(self, depth: int) -> tuple[dict[Any, Any], int]:
        found: dict[Any, Any] = {}
        merged: dict[Any, Any] = {}
        size = 1
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            key, of_key = self._value(event, depth)
            merges = key == "<<" and getattr(event, "implicit", (False,))[0]
            if not isinstance(key, Hashable):
                raise self._error(event, key, "not valid YAML: a key is text or a number")
            if not merges and key in found:
                raise self._error(event, key, "not valid YAML: duplicate key")
            value, of_value = self._value(next(self._events), depth)
            size += of_key + of_value
            if not merges:
                found[key] = value
                continue
            for other in value if isinstance(value, list) else [value]:
                if not isinstance(other, dict):
                    raise self._error(event, other, "not valid YAML: only mappings can be merged")
                self._add_to_count(len(other), event)
                # Of several, the first one's keys count.
                merged = {**other, **merged}
        return {**merged, **found}, size

    def _add_to_count(self, values: int, event: Any) -> None:
        self._count += values
        if self._count > VALUE_LIMIT:
            rule = f"at most {VALUE_LIMIT} values with all aliases written out"
            raise self._error(event, self._count, rule)

    def _resolved(self, event: Any) -> Any:
        """Return a scalar's value."""
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
        read = next((read for form, read in _NUMBERS if form.fullmatch(text)), str)
        if read is not str and len(text) > NUMBER_LIMIT:
            rule = f"a number has at most {NUMBER_LIMIT} characters"
            raise self._error(event, text, rule)
        return read(text)

    def _error(self, event: Any, value: object, rule: str) -> FileError:
        return FileError(self._source, value, rule, _line(event.start_mark.line))


def _line(number: int) -> str:
    return f"line {number + 1}"
