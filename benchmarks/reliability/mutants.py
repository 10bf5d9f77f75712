# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mutants of files: changes that a seed decides, from single bits to what is known to do harm."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

NUMBER = re.compile(rb"(?<![\w.])-?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][\w.:/-]*")
NUMBERS = (
    *(b"0", b"-1", b"1e30", b"-1e30", b"1e-30", b"nan", b".nan", b"inf", b"-.inf", b"1e999"),
    *(b"0b", b"0b1", b"0x", b"0o9", b"1_000", b"9" * 30, b"9" * 5000, b"-0", b"1e", b"~", b""),
    *(b"4294967295", b"2147483648", b"18446744073709551615", b"9223372036854775808"),
)
MERGES = b"".join(
    b"a%d: &a%d {<<: [%s]}\n" % (k, k, b", ".join([b"*a%d" % (k - 1)] * 10)) for k in range(1, 12)
)
ALIASES = b"".join(
    b"a%d: &a%d [%s]\n" % (k, k, b", ".join([b"*a%d" % (k - 1)] * 10)) for k in range(1, 12)
)
# Put somewhere into a file, or around all of it.
BOMBS = (
    b"a0: &a0 {x: 1, y: 2}\n" + MERGES,
    b"a0: &a0 [x, x]\n" + ALIASES,
    b"[" * 5000,
    b"{" * 5000,
    b"<a>" * 5000,
    b"<body>" * 1000,
    b'<!DOCTYPE r [<!ENTITY a "aa"><!ENTITY b "&a;&a;&a;">]>',
    b"x" * 300,
    b"\0" * 100,
    b"\xff\xfe",
    b"../" * 50 + b"etc/passwd",
    b"/dev/zero",
    b"!!python/object/apply:os.system [true]",
)
Change = Callable[[bytearray, random.Random], None]


def mutated(data: bytes, chance: random.Random) -> bytes:
    """Return bytes with one to four changes; every third has a number that is a little another."""
    found = bytearray(data)
    if chance.random() < 0.3:
        _mild(found, chance)
        return bytes(found)
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        if found:
            chance.choice(_CHANGES)(found, chance)
    return bytes(found)


def _bits(data: bytearray, chance: random.Random) -> None:
    for _ in range(chance.choice((1, 1, 8, 64))):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)


def _removed(data: bytearray, chance: random.Random) -> None:
    """Remove a part, or all that is behind a place."""
    at = chance.randrange(len(data))
    del data[at : at + chance.choice((1, 4, 50, 500, *[len(data)] * 4))]


def _copied(data: bytearray, chance: random.Random) -> None:
    """Put a part somewhere else, once or often, between what is there or in its place."""
    begin, at = chance.randrange(len(data)), chance.randrange(len(data))
    part = data[begin : begin + chance.choice((1, 4, 40, 400))]
    data[at : at + chance.choice((0, len(part)))] = part * chance.choice((1, 1, 1, 2, 10, 300))


def _number(data: bytearray, chance: random.Random) -> None:
    _replaced(data, chance, NUMBER, chance.choice(NUMBERS))


def _mild(data: bytearray, chance: random.Random) -> None:
    """Change a number so little that what is behind the readers gets to see it."""
    found = list(NUMBER.finditer(bytes(data[:100_000])))
    if not found:
        _bits(data, chance)
        return
    one = chance.choice(found)
    try:
        value = float(one[0]) * chance.choice((0.0, -1.0, 0.5, 1.01, 3.0, 1e3, 1e-3))
    except ValueError:
        return
    written = repr(value) if b"." in one[0] or value % 1 else str(int(value))
    data[one.start() : one.end()] = written.encode()


def _word(data: bytearray, chance: random.Random) -> None:
    if words := WORD.findall(bytes(data[:100_000])):
        _replaced(data, chance, WORD, chance.choice(words) * chance.choice((1, 1, 1, 60)))


def _integer(data: bytearray, chance: random.Random) -> None:
    """Write an extreme number as binary formats have it."""
    size = chance.choice((1, 2, 4, 8))
    at = chance.randrange(len(data))
    value = chance.choice((0, 1, 255, 2**31, 2**32 - 1, 2**62, 2**63, 2**64 - 1)) % 256**size
    data[at : at + size] = value.to_bytes(size, chance.choice(("little", "big")))


def _bomb(data: bytearray, chance: random.Random) -> None:
    at = chance.choice((0, chance.randrange(len(data)), len(data)))
    data[at:at] = chance.choice(BOMBS)


def _replaced(
    data: bytearray, chance: random.Random, pattern: re.Pattern[bytes], by: bytes
) -> None:
    if found := list(pattern.finditer(bytes(data[:100_000]))):
        one = chance.choice(found)
        data[one.start() : one.end()] = by


_CHANGES: tuple[Change, ...] = (
    *(_bits, _removed, _removed, _copied, _copied),
    *(_number, _number, _number, _word, _integer, _bomb),
)
