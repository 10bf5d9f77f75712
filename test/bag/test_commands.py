# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech bag`` without ROS: what it prints, and how it ends."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bag.record import MS, WRENCH, Bytes, record
from hapticmech_ros.bag import BagWriter
from hapticmech_ros.cli import bag_tables
from hapticmech_ros.cli.bag import app
from hapticmech_ros.errors import HapticMechError


def run(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout


def says(code: int, *words: str, of: tuple[str | Path, ...]) -> None:
    """Run a command that ends with a code, and check that it prints all these words."""
    found, text = run(*of)
    assert found == code
    assert [one for one in words if one not in text] == []


def write(path: Path, make: Bytes, offset: float = 0.0, count: int = 20) -> Path:
    return record(path, [("/f", i * MS, make(i * MS, i + offset)) for i in range(1, count + 1)])


def test_info(tmp_path: Path, wrench_bytes: Bytes) -> None:
    path = write(tmp_path / "bag", wrench_bytes)
    says(0, "20 messages", "WrenchStamped", of=("info", path))
    _, text = run("info", path, "--json")
    assert json.loads(text)["topics"][0]["rate_hz"] == pytest.approx(1000.0)


LONG = "/teleoperation_controller/transition_event_of_it"


@pytest.mark.parametrize("width", [80, 100, 200])
@pytest.mark.parametrize("command", ["info", "check"])
def test_tables_fit_the_terminal_and_names_are_whole(
    command: str, width: int, tmp_path: Path, wrench_bytes: Bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bag_tables.console, "width", width)
    record(tmp_path / "bag", [(LONG, MS, wrench_bytes(MS, 1.0))])
    code, text = run(command, tmp_path / "bag")
    assert code == 0
    tables = [line for line in text.splitlines() if str(tmp_path) not in line]
    assert max(map(len, tables)) <= width
    assert LONG in text
    wanted = ("geometry_msgs/WrenchStamped",) if command == "info" else ("missing", "gap ms")
    for words in ("messages", *wanted):
        assert words in text


def test_check_of_one_bag(tmp_path: Path, wrench_bytes: Bytes) -> None:
    path = write(tmp_path / "bag", wrench_bytes)
    says(0, "is sound", of=("check", path, "--json", tmp_path / "report.json"))
    assert json.loads((tmp_path / "report.json").read_text())["sound"] is True
    (path / "metadata.yaml").unlink()
    says(1, "hapticmech bag repair", of=("check", path))


@pytest.mark.parametrize("name", ["/f", "/device/state"])
def test_a_bag_without_samples_is_empty_and_not_sound(
    name: str, tmp_path: Path, wrench_bytes: Bytes
) -> None:
    """Of this package's graph, what is latched is no sample."""
    path = tmp_path / "bag"
    with BagWriter(path) as bag:
        bag.add_topic(name, WRENCH)
        if name != "/f":
            bag.add_topic("/mechanism/closures", WRENCH)
            bag.write("/mechanism/closures", MS, wrench_bytes(MS, 1.0))
    code, text = run("check", path, "--json", tmp_path / "report.json")
    assert code == 1
    assert "is empty" in text
    assert "sound" not in text
    report = json.loads((tmp_path / "report.json").read_text())
    assert (report["empty"], report["sound"]) == (True, False)


def test_check_of_two_bags(tmp_path: Path, wrench_bytes: Bytes) -> None:
    a = write(tmp_path / "a", wrench_bytes)
    b = write(tmp_path / "b", wrench_bytes, offset=0.25)
    short = write(tmp_path / "short", wrench_bytes, count=19)
    # The largest deviation is that of the force's y: 2 x 0.25.
    assert run("check", a, b)[0] == 0
    assert run("check", a, b, "--tolerance", "0.5")[0] == 0
    assert run("check", a, b, "--tolerance", "0.49")[0] == 1
    assert run("check", a, b, "--exact")[0] == 1
    assert run("check", a, a, "--exact", "--tolerance", "0")[0] == 0
    assert run("check", a, short, "--tolerance", "0")[0] == 0
    assert run("check", a, short, "--exact")[0] == 1
    assert run("check", short, a, "--exact")[0] == 0
    run("check", a, b, "--json", tmp_path / "report.json")
    found = json.loads((tmp_path / "report.json").read_text())
    assert found["topics"]["/f"]["fields"]["wrench.force.y"]["largest"] == 0.5


def test_bags_that_share_nothing_do_not_pass(tmp_path: Path, wrench_bytes: Bytes) -> None:
    a = write(tmp_path / "a", wrench_bytes)
    b = record(tmp_path / "b", [("/f", 1, wrench_bytes(10**18, 1.0))])
    assert run("check", a, b, "--tolerance", "1000")[0] == 1


def test_repair(tmp_path: Path, wrench_bytes: Bytes) -> None:
    path = write(tmp_path / "bag", wrench_bytes)
    (path / "metadata.yaml").unlink()
    says(0, f"20 messages recovered into {tmp_path / 'bag_repaired'}", of=("repair", path))
    (path / "bag_0.mcap").write_bytes(b"nothing")
    assert run("repair", path, "--out", tmp_path / "other")[0] == 1


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        (("record", "--all", "/x", "--out", "bag"), "cannot be together"),
        (("play", "bag", "--remap", "/x=/y"), "must be FROM:=TO"),
    ],
)
def test_refuses_contradictions(
    arguments: tuple[str, ...], rule: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(HapticMechError, match=rule):
        run(*arguments)
