# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a running graph is, and how it was: one line meanwhile, a table at the end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.status import Status
from rich.table import Table

from hapticmech_ros.cli.console import console
from hapticmech_ros.readiness import Report
from hapticmech_ros.wire.topics import ANALYSER, CONTROLLER, DEVICE, MECHANISM, REAL_DEVICES

DEVICES = {DEVICE, *REAL_DEVICES}
Reports = Mapping[str, Report]


class LiveLine:
    """Shows how a graph is, where somebody looks.

    Args:
        status: of a terminal; None: nobody looks.
    """

    def __init__(self, status: Status | None) -> None:
        self._status = status

    def show(self, reports: Reports) -> None:
        """Show what nodes have said last."""
        if self._status is not None and reports:
            self._status.update(escape(line_of(reports)))


@contextmanager
def live_line() -> Iterator[LiveLine]:
    """Give a line at the end of the terminal; nothing where the output is none.

    Yields:
        The line.
    """
    if not console.is_terminal:
        yield LiveLine(None)
        return
    with console.status("starting") as status:
        yield LiveLine(status)


def line_of(reports: Reports) -> str:
    """Return how a graph is in one line: what is rendered and felt, rate, deadlines missed."""
    parts = []
    for name, report in sorted(reports.items()):
        kind, figures = name.rpartition("/")[2], report.figures
        where = name.strip("/").rpartition("/")[0]
        if kind in DEVICES:
            rate, missed = figures.get("achieved_rate_hz", "-"), _share(figures)
            said = f"{report.sentence}, {rate} Hz, missed {missed}"
            if "periods_without_sample" in figures:
                said += f", no sample in {_share(figures, 'periods_without_sample')}"
        elif kind == ANALYSER or not report.well:
            said = report.sentence if kind == ANALYSER else f"{kind}: {report.sentence}"
        else:
            continue
        parts.append(f"{where}: {said}" if where else said)
    return "; ".join(parts)


def show_ends(reports: Reports, endings: Reports) -> None:
    """Print how each node was, and what it counted."""
    if not endings:
        return
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False, pad_edge=False)
    for heading in ("node", "at the end", "Hz", "missed", "age p50 / p99, ms"):
        left = heading in ("node", "at the end")
        table.add_column(heading, justify="left" if left else "right", overflow="fold")
    for name, ending in sorted(endings.items()):
        # Nodes end one after the other, and what the last ones miss then is no news.
        sentence = reports.get(name, ending).sentence
        figures = ending.figures
        ages = [figures.get(f"message_age_{share}_us", "") for share in ("p50", "p99")]
        age = " / ".join(f"{float(us) / 1e3:.2f}" for us in ages) if all(ages) else "-"
        rate = figures.get("achieved_rate_hz", "-")
        table.add_row(escape(name), escape(sentence), rate, _share(figures), age)
    console.print(table)
    for name, ending in sorted(endings.items()):
        for note in _notes(ending):
            console.print(f"{name}: {note}", highlight=False, markup=False, soft_wrap=True)


def nothing_rendered(reports: Reports, endings: Reports) -> str:
    """Return why nothing was rendered by a whole graph; empty if something was, or it was none."""
    kinds = {name.rpartition("/")[2]: report for name, report in endings.items()}
    if not ({MECHANISM, ANALYSER, CONTROLLER} <= set(kinds) and DEVICES & set(kinds)):
        return ""
    if any(int(report.figures.get("engagements", "0")) > 0 for report in endings.values()):
        return ""
    why = [
        f"{name}: {reports.get(name, report).sentence}"
        for name, report in sorted(endings.items())
        if not reports.get(name, report).well
    ]
    return f"nothing was rendered: {'; '.join(why) or 'it ended too soon'}"


def _share(figures: Mapping[str, str], what: str = "missed_deadlines") -> str:
    """Return the share of deadlines missed, or of what else is counted, of nodes that have any."""
    periods, missed = figures.get("periods"), figures.get(what)
    if periods is None or missed is None:
        return "-"
    return f"{int(missed) / max(int(periods), 1):.1%}"


def _notes(report: Report) -> Iterator[str]:
    """Yield what should not have happened."""
    figures = report.figures
    for key, what in (
        ("failures", "failures, the last: {last_failure}"),
        ("refused_messages", "messages refused, the last: {last_refusal}"),
        ("steps_inaccurate", "inaccurate steps"),
        ("dropped_periods", "periods dropped"),
        ("periods_without_sample", "periods in which the device did not answer"),
        ("clock_steps", "steps of the clock, the last: {last_clock_step}"),
    ):
        count = figures.get(key, "0")
        if count != "0":
            given = {k: figures.get(k, "") for k in ("last_failure", "last_refusal")}
            yield f"{count} {what.format(**given, last_clock_step=figures.get('last_clock_step'))}"
    without = int(figures.get("lost_without_processor", "0"))
    paused = int(figures.get("lost_while_sender_paused", "0"))
    if without or paused:
        yield (
            f"rendering ended {figures['losses']} times because of a silence: {without} times this "
            f"process had no processor, {paused} times the sender had paused (docs/realtime.md)"
        )
