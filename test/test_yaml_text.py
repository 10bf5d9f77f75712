# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""YAML of strangers: the core schema of YAML 1.2, within limits, in time linear in its length."""

import math
from pathlib import Path

import pytest
import yaml
from ruamel.yaml import YAML

from hapticmech_ros.errors import FileError
from hapticmech_ros.files import yaml_text
from hapticmech_ros.files.yaml_text import read_yaml

ROOT = Path(__file__).resolve().parents[1]
FILES = sorted([*ROOT.glob("config/**/*.yaml"), *ROOT.glob("examples/*.yaml")])
SCALARS = {
    "12": 12, "-12": -12, "+1": 1, "010": 10, "0o17": 15, "0x1f": 31, "1e3": 1000.0, "1.5": 1.5,
    ".5": 0.5, "5.": 5.0, "-1.e-2": -0.01, ".inf": math.inf, "-.INF": -math.inf, "true": True,
    "False": False, "null": None, "~": None, "": None, "yes": "yes", "off": "off", "0b1": "0b1",
    "0b": "0b", "0o": "0o", "0x": "0x", "1_000": "1_000", "1:30": "1:30",
    "2001-01-01": "2001-01-01", "+": "+", ".": ".", "1e": "1e",
    "'12'": "12", '"true"': "true", "!!str 12": "12",
    "!!float 1": 1.0, "!!int 3": 3, "! 12": "12", "1e999": math.inf, "a b": "a b",
}  # fmt: skip


@pytest.mark.parametrize("text", SCALARS)
def test_scalars_are_those_of_the_core_schema(text):
    found = read_yaml(f"a: {text}", "x")["a"]
    assert (type(found), found) == (type(SCALARS[text]), SCALARS[text])


def test_an_anchor_stands_for_what_had_it_last():
    text = "a: &x [1, 2]\nb: *x\nc: &x 3\nd: *x"
    assert read_yaml(text, "x") == {"a": [1, 2], "b": [1, 2], "c": 3, "d": 3}


def test_not_a_number_is_one():
    assert math.isnan(read_yaml(".nan", "x"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_our_files_say_what_another_reader_reads(path):
    text = path.read_text(encoding="utf-8")
    assert read_yaml(text, "x") == YAML(typ="safe", pure=True).load(text)


@pytest.mark.parametrize(
    "text",
    [
        "a: &x {b: 1, c: 2}\nd: {<<: *x, c: 3}",
        "a: &x {b: 1}\nc: &y {b: 2, d: 3}\ne: {<<: [*x, *y], f: 4}",
        "a: &x {b: 1}\nc: &y {<<: *x, d: 2}\ne: {<<: *y, b: 5}",
        "a: {<<: {b: 1}, c: 2}",
        "a: &x [1, 2]\nb: *x",
        '"<<": 1',
        "a: &x\nb: *x",
        "- &a {}\n- &b []\n- [*a, *b]",
    ],
)
def test_aliases_and_merges_say_what_another_reader_reads(text):
    assert read_yaml(text, "x") == YAML(typ="safe", pure=True).load(text)


def test_without_libyaml_the_same_is_read(monkeypatch):
    text = (ROOT / "config" / "scenes" / "five_bar.yaml").read_text(encoding="utf-8")
    expected = read_yaml(text, "x")
    monkeypatch.setattr(yaml_text, "_LOADER", yaml.SafeLoader)
    assert read_yaml(text, "x") == expected
    with pytest.raises(FileError, match="line 2: not valid YAML"):
        read_yaml("a: 1\n---\nb: 2\n", "x")


def test_libyaml_reads():
    """At the speed that is promised; the other parser takes ten times as long."""
    assert yaml_text._LOADER is yaml.CSafeLoader


LIMIT_BREAKERS = {
    "brackets": ("[" * 4_000_000, "nested too deeply"),
    "braces": ("{" * 4_000_000, "nested too deeply"),
    "dashes": ("- " * 2_000_000, "nested too deeply"),
    "questions": ("? " * 2_000_000, "nested too deeply"),
    "colons": (":" * 4_000_000, "not valid YAML"),
    "anchors": ("[" + "&a a," * 600_000 + "]", "at most 200000 values"),
    "tags": ("[" + "!a a," * 600_000 + "]", "unknown tag"),
    "flow keys": ("{" + ",".join(f"k{k}" for k in range(300_000)) + "}", "at most 200000 values"),
    "directives": ("%a\n" * 1_000_000, "not valid YAML"),
    "digits": ("9" * 4_000_000, "at most 400 characters"),
}


@pytest.mark.parametrize("name", LIMIT_BREAKERS)
def test_long_texts_end_at_a_limit(name):
    text, rule = LIMIT_BREAKERS[name]
    with pytest.raises(FileError, match=rule) as caught:
        read_yaml(text, "long.yaml")
    assert caught.value.file == "long.yaml"
    assert len(str(caught.value)) < 300
