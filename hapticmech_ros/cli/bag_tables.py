# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of ``hapticmech bag``."""

from __future__ import annotations

from datetime import datetime, timezone

from hapticmech_ros.analysis.study import Sheet
from hapticmech_ros.bag.check import BagCheck, BagInfo
from hapticmech_ros.bag.compare import BagComparison
from hapticmech_ros.bag.repair import RepairReport
from hapticmech_ros.cli.console import WIDEST_NAME, console, say


def show_info(info: BagInfo) -> None:
    """Print the contents of a bag."""
    say(f"{info.path}: {info.storage}, {_size(info.bytes)}, {info.messages} messages")
    if not info.finished:
        say("unfinished: still being recorded, or interrupted; counts may be outdated", "yellow")
    if info.compression:
        say(f"compression: {info.compression}")
    if info.lost:
        losses = (f"{name} {'?' if count is None else count}" for name, count in info.lost.items())
        say(f"lost while recording: {', '.join(losses)}", "yellow")
    if info.messages:
        say(f"start {_date(info.start_ns)}, duration {info.duration_s:.3f} s")
    for file in info.files:
        count = "" if file.messages is None else f", {file.messages} messages"
        span = "" if file.duration_s is None else f", {file.duration_s:.3f} s"
        say(f"  {file.name}: {_size(file.bytes)}{count}{span}")
    rows = tuple(
        (
            topic.name,
            str(topic.count),
            f"{topic.rate_hz:.1f}",
            ", ".join((*topic.reliability, *topic.durability)) or "?",
            topic.type.replace("/msg/", "/"),
        )
        for topic in info.topics
    )
    headings = ("topic", "messages", "Hz", "QoS", "type")
    console.print(Sheet("", headings, rows, ("QoS", "type"), kept=WIDEST_NAME))
    hashes = {(topic.type.replace("/msg/", "/"), _short(topic.type_hash)) for topic in info.topics}
    console.print(Sheet("", ("type", "type hash"), tuple(sorted(hashes)), kept=WIDEST_NAME))


def show_check(checked: BagCheck) -> None:
    """Print the result of a bag's check."""
    rows = []
    for topic in checked.topics:
        notes = list(topic.notes)
        if topic.undecodable:
            notes.append(f"{topic.undecodable} cannot be decoded")
        if topic.repeated:
            notes.append(f"{topic.repeated} repeated stamps")
        cells = (
            str(topic.count),
            f"{topic.rate_hz:.1f}",
            "?" if topic.lost is None else str(topic.lost),
            f"{1e3 * topic.largest_gap_s:.1f}",
            str(topic.backwards) if topic.stamped else "-",
            "; ".join(notes),
        )
        rows.append((topic.name, *cells))
    headings = ("topic", "messages", "Hz", "missing", "gap ms", "stamps back", "notes")
    if rows:
        console.print(Sheet("", headings, tuple(rows), ("notes",), kept=WIDEST_NAME))
    for name in checked.absent:
        say(f"not recorded: {name}", "yellow")
    for trouble in checked.damage:
        say(f"damaged: {trouble}", "red")
    if checked.is_empty and not checked.damage:
        say(f"{checked.path} is empty: no samples were recorded", "yellow")
    if checked.is_sound:
        say(f"{checked.path} is sound", "green")


def show_comparison(compared: BagComparison) -> None:
    """Print the deviations of a second bag from the first."""
    rows = []
    for topic in compared.topics:
        worst = topic.worst
        differs = worst is not None and worst.largest > 0.0
        cells = (
            topic.matched_by,
            str(topic.matched),
            str(topic.missing),
            str(topic.extra),
            str(topic.equal),
            f"{worst.largest:.3g}" if worst is not None else "-",
            f"{worst.rms:.3g}" if worst is not None else "-",
            f"{worst.name} at {worst.worst_at_ns} ns" if worst is not None and differs else "",
        )
        rows.append((topic.name, *cells))
    numbers = ("matched", "missing", "extra", "equal bits", "largest", "rms")
    headings = ("topic", "matched by", *numbers, "at")
    console.print(Sheet("", headings, tuple(rows), ("matched by", "at"), kept=WIDEST_NAME))
    for name in compared.missing_topics:
        say(f"not in {compared.actual}: {name}", "yellow")
    for name in compared.extra_topics:
        say(f"only in {compared.actual}: {name}", "yellow")


def show_repair(done: RepairReport) -> None:
    """Print recovered and lost messages of a repair."""
    for file in done.files:
        trouble = f"; {file.trouble}" if file.trouble else ""
        lost = f"; {file.lost_bytes} bytes lost" if file.lost_bytes else ""
        say(f"{file.name}: {file.messages} messages{trouble}{lost}")
    for name, count in sorted(done.counts.items()):
        say(f"  {name}: {count} messages")
    for name, reason in sorted(done.refused.items()):
        say(f"  {name}: lost, {reason}", "red")
    if done.stated is not None and done.stated != done.messages:
        say(f"according to its metadata the damaged bag had {done.stated} messages", "yellow")
    say(f"{done.messages} messages recovered into {done.path}")


def _size(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 100_000 else f"{size / 1e3:.1f} kB"


def _date(time_ns: int) -> str:
    when = datetime.fromtimestamp(time_ns / 1e9, tz=timezone.utc).astimezone()
    return when.strftime("%Y-%m-%d %H:%M:%S.%f %z")


def _short(type_hash: str) -> str:
    return f"{type_hash.removeprefix('RIHS01_')[:8]}…" if type_hash else "?"
