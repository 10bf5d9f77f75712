# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The summary of a run as short tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rich.table import Table

NOTHING = "–"


def tables(summary: Mapping[str, Any]) -> Iterator[Table]:
    """Yield the tables of a result of ``write_results`` or ``write_shared_results``."""
    if "users" not in summary:
        yield table(summary)
        return
    for point, user in summary["users"].items():
        yield table({**user, "scene": f"{user['scene']}, {point}"})
    yield _spans(summary["spans"])


def _spans(spans: list[Mapping[str, Any]]) -> Table:
    """Return a row for each user and span of time in which the same hands hold."""
    title = "while the same hands hold: largest displacement, rms forces, constraints"
    result = Table(title=title, title_justify="left")
    for name in ("from, s", "holding", "user"):
        result.add_column(name)
    for name in ("moved, mm", "force, N", "by others, N", "count"):
        result.add_column(name, justify="right")
    for span in spans:
        for point, user in span["users"].items():
            result.add_row(
                _number(span["begin_s"], 1.0, "", 2),
                ", ".join(span["holding"]) or NOTHING,
                point,
                _number(user["displacement_max_m"], 1e3, "", 1),
                _number(user["hand_force_rms_n"], 1.0, "", 2),
                _number(user["by_others_force_rms_n"], 1.0, "", 2),
                ", ".join(str(count) for count in user["counts_seen"]) or NOTHING,
            )
    return result


def table(summary: Mapping[str, Any]) -> Table:
    """Return a table of two columns of a result of :func:`summarise` or ``write_results``."""
    result = Table(title=f"{summary['scene']} ({summary['source']})", title_justify="left")
    result.add_column("quantity")
    result.add_column("value", justify="right")
    for name, value in [
        *_constraint_rows(summary["constraints"]),
        *_error_rows(summary),
        *_graph_rows(summary.get("graph")),
        *_agreement_rows(summary.get("agreement")),
    ]:
        result.add_row(name, value)
    return result


def _constraint_rows(constraints: Mapping[str, Any]) -> list[tuple[str, str]]:
    changes = [f"{c['from']} → {c['to']} at {c['time_s']:.3f} s" for c in constraints["changes"]]
    seen = ", ".join(str(count) for count in constraints["counts_seen"])
    rows = [("joint constraints", "; ".join(changes) or f"{seen} throughout")]
    for held in constraints["while_held"]:
        force = _number(held["force_rms_n"], 1.0, "N", 3)
        expected = _number(held["expected_force_rms_n"], 1.0, "N", 3)
        heading = f"force of {held['count']} constraint(s), rms (expected)"
        rows.append((heading, f"{force} ({expected})"))
    return rows


def _error_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return rows of errors, those of steps and of pauses only where there are some."""
    tracking, energy, coverage = summary["tracking"], summary["energy"], summary["coverage"]
    position = [_number(tracking[f"position_error_{k}_m"], 1e3, "mm", 3) for k in ("rms", "max")]
    rotation = [
        _number(tracking[f"rotation_error_{k}_rad"], 1e3, "mrad", 2) for k in ("rms", "max")
    ]
    rows = [
        ("distance of hand and mechanism, rms / max", " / ".join(position)),
        ("angle between the two, rms / max", " / ".join(rotation)),
        ("error of closed loops, max", _power(summary["closure_error_max_m_or_rad"], "m, rad")),
        ("error of the energy balance, max", _power(energy["balance_error_max_j"], "J")),
    ]
    if energy.get("steps_inaccurate"):
        rows.append(("steps above the energy tolerance", str(energy["steps_inaccurate"])))
    if not coverage["complete"]:
        worst = max(coverage["groups"].items(), key=lambda item: float(item[1]["longest_pause_s"]))
        text = f"no {worst[0]} for {worst[1]['longest_pause_s']:.2f} s"
        rows.append(("recording incomplete", text))
    return rows


def _graph_rows(graph: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    """Return rows of a graph's run: interruptions, other gains and losses only if known."""
    if graph is None:
        return []
    nominal, missed = f"{graph['nominal_rate_hz']:g} Hz", graph["missed_deadlines"]
    measured = _number(graph["measured_rate_hz"], 1.0, "Hz", 1)
    latency = [_number(graph[f"loop_latency_{k}_us"], 1e-3, "", 2) for k in ("p50", "p99", "max")]
    rows = [
        ("rate, measured (wanted)", f"{measured} ({nominal})"),
        ("deadlines missed, all nodes", NOTHING if missed is None else f"{missed:g}"),
        ("loop latency p50 / p99 / max, ms", " / ".join(latency)),
    ]
    if graph["interruptions"]:
        paused = f"processes paused {graph['losses_by_pauses'] or 0:g} times"
        rows.append(("interruptions of the rendering", f"{graph['interruptions']}; {paused}"))
    if graph["reduced_gains"]:
        rows.append(("gains", "reduced, since the loop took longer than they allow"))
    if graph["lockstep"]:
        rows = [("rate, in lockstep", nominal)]
    if graph["recorder_lost"] is not None:
        rows.append(("messages lost by the recorder", str(graph["recorder_lost"])))
    return rows


def _agreement_rows(agreement: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    if agreement is None:
        return []
    deviations = [
        _number(agreement[f"{b}_deviation_max_mm"], 1.0, "mm", 3) for b in ("device", "point")
    ]
    apart = agreement["count_change_difference_max_s"]
    return [
        ("deviation from session, device / point, max", " / ".join(deviations)),
        ("times of changes differ by, max", _number(apart, 1e3, "ms", 1)),
    ]


def _number(value: object, factor: float, unit: str, digits: int) -> str:
    if not isinstance(value, int | float):
        return NOTHING
    return f"{factor * value:.{digits}f} {unit}".rstrip()


def _power(value: float | None, unit: str) -> str:
    return NOTHING if value is None else f"{value:.1e} {unit}"
