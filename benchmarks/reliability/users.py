# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two users on two hosts: what one does is felt by the other, and the loss of one frees only him.

A body without weight is held at both ends by arms. The far one, behind a network with a delay that
its hand declares, moves its target by x; the near one is beside the mechanism. At rest the springs
of both balance each other, whatever the delay: k_far (x - s) = k_near s.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from benchmarks.children import BenchError
from benchmarks.reliability.emulated_network import DEVICE, REST, EmulatedNetwork, Path
from benchmarks.reliability.figure import Figure, unmeasured
from benchmarks.reliability.network import BACK_S, ENERGY_J, KINDS, NO_DELAY
from benchmarks.reliability.split_graph import Array, SplitGraph, Watched, of_two_users, run_for
from hapticmech_ros.scene import Scene, document_of, scene_from_document
from hapticmech_ros.session import SharedSession

NEAR, FAR = "near", "far"
# J, slack of passivity control at each port: the shipped one, and one so small that it acts.
SLACK_J, TIGHT_J = 0.1, 1e-3
# Delay, s, each way; kind of path; and slack, J.
TRIALS = (
    (0.0, "plain", SLACK_J),
    (0.01, "plain", SLACK_J),
    (0.01, "all of it", SLACK_J),
    (0.05, "plain", SLACK_J),
    (0.05, "all of it", SLACK_J),
    (0.05, "plain", TIGHT_J),
)
QUICK = ((0.01, "all of it", SLACK_J), (0.05, "plain", SLACK_J))
# J, by which a graph's energy in sum may be below a session's.
SUM_J = 4e-3
# m, of the ends from the centre of mass; N/m; and m, of the far arm's target along the body.
REACH, STIFFNESS, WAY = 0.06, {NEAR: 100.0, FAR: 300.0}, 0.02
RESTS_AT = WAY * STIFFNESS[FAR] / (STIFFNESS[NEAR] + STIFFNESS[FAR])
# s, from taking hold to the far arm's motion, its duration, and until all rests again.
WAITS_S, MOVES_S, SETTLES_S = 2.5, 0.5, 3.0
# s, from rendering on: when the network is cut and mended, when the far device is killed, the end.
CUT_S, MENDED_S, KILLED_S, END_S = 8.0, 9.5, 12.0, 20.0
# s, that a force is watched for after what was killed says that it renders.
RENDERED_S = 1.0
# s, within which the body has come back to where the near arm alone holds it.
RETURNS_S = 1.4
# Shares of the way; less than a per cent of it is left of the near arm's oscillation by then.
REST_ERROR, MOTION_ERROR = 0.01, 0.1
HELD = 0.98
TRIES = 5
# s, instead of 12 ms: seven processes at 1 kHz on two cores; and how much later a device lets go.
TIMEOUT_S = 0.05
PATIENT = {
    "haptic_device.command_timeout": TIMEOUT_S,
    "teleoperation_controller.input_timeout": TIMEOUT_S,
}
MARGIN_S = TIMEOUT_S + 0.008


@dataclass(frozen=True)
class Seen:
    """What both devices went through.

    Attributes:
        near, far: each.
        cut, mended, killed: s of the clock, when the network was cut and mended, and when the far
            device was killed.
    """

    near: Watched
    far: Watched
    cut: float
    mended: float
    killed: float

    @property
    def begun(self) -> float:
        """When the far hand took hold last before the cut, s; infinite if it did not."""
        time, obeys = self.far.time, self.far.obeys
        holds = np.flatnonzero(obeys & (time < self.cut) & ~np.roll(obeys, 1))
        return float(time[holds[-1]]) if holds.size else np.inf

    @property
    def unbroken(self) -> bool:
        """Whether both were held from before the far arm's motion until the cut."""
        start = self.begun + 0.5 * WAITS_S
        held = [one.obeys[(one.time > start) & (one.time < self.cut)] for one in self.both]
        lasted = self.cut - self.begun > WAITS_S + MOVES_S + SETTLES_S
        return lasted and all(bool(obeys.all()) for obeys in held)

    def kept_up(self, period: float) -> bool:
        """Return whether three of four periods (s) of the far arm's motion were both devices' own.

        Periods that a starved machine drops are missed by the mechanism too, which is late then.
        """
        return all(self._moving(one).sum() > 0.75 * MOVES_S / period for one in self.both)

    def delay(self, period: float) -> float:
        """Return what each way of the far device took while its arm moved, median, s.

        A session's round trip takes a period (s) by design, and both ways.
        """
        return 0.5 * (float(np.median(self.far.round_trip[self._moving(self.far)])) - period)

    def _moving(self, one: Watched) -> NDArray[np.bool_]:
        """Return (n,) which of a device's samples are of the far arm's motion."""
        start = self.begun + WAITS_S
        return (one.time > start) & (one.time < start + MOVES_S)

    @property
    def both(self) -> tuple[Watched, Watched]:
        """The near one and the far one."""
        return self.near, self.far

    def moved(self) -> tuple[Array, Array]:
        """Return times (n,), s since the far hand took hold, and the near device's way (n,), m."""
        time, x = self.near.time - self.begun, self.near.position[:, 0]
        before = (time > 0.5 * WAITS_S) & (time < WAITS_S)
        wanted = (time > WAITS_S) & (time < self.cut - self.begun)
        return time[wanted], x[wanted] - np.median(x[before])

    def rests_at(self, end: float, lasting: float = 0.2) -> float:
        """Return the near device's way (m) as ``moved``, median of some time before another (s)."""
        time, x = self.near.time, self.near.position[:, 0]
        before = (time > self.begun + 0.5 * WAITS_S) & (time < self.begun + WAITS_S)
        return float(np.median(x[(time > end - lasting) & (time < end)]) - np.median(x[before]))

    def held(self, start: float, end: float) -> float:
        """Return for which share of the time between two (s) the near device obeyed."""
        inside = (self.near.time > start) & (self.near.time < end)
        return float(self.near.obeys[inside].mean()) if inside.any() else 0.0

    def energies(self) -> tuple[float, float, float]:
        """Return the least E_h, J, at the near port, at the far one, and in sum, until the cut.

        That of a port counts with what the mechanism supplied there; that of both together counts
        alone, since a body at rest without weight has nothing to supply.
        """
        times = np.arange(self.begun + 0.1, self.cut, 0.01)
        ports, total = [], np.zeros(times.size)
        for one in self.both:
            time, hand = one.energy_time, one.from_hand
            gave = np.maximum.accumulate(np.maximum(-one.to_mechanism, 0.0))
            ports.append(float((hand + gave)[(time > self.begun) & (time < self.cut)].min()))
            total += np.interp(times, time, hand)
        return ports[0], ports[1], float(total.min())


def held_body(path: Path, declared: bool, period: float = 1e-3, slack: float = SLACK_J) -> Scene:
    """Return the scene of both users, over a path that the far hand's entry declares or simulates.

    Args:
        path: between far device and the rest.
        declared: as ``expected``, for a graph over a real path; otherwise simulated, for a session.
        period: of control, s.
        slack: of passivity control at each port, J.
    """
    arm = {"kind": "arm", "mass": 0.3, "damping": 8.0, "angular_stiffness": 0.5}
    arm |= {"angular_inertia": 5e-4, "angular_damping": 0.05}
    way = [{"time": 0.0}, {"time": MOVES_S, "xyz": [WAY, 0.0, 0.0]}]
    near = arm | {"stiffness": STIFFNESS[NEAR], "start_delay": 0.0, "waypoints": way[:1]}
    far = arm | {"stiffness": STIFFNESS[FAR], "start_delay": WAITS_S, "waypoints": way}
    late = {"delay": path.delay, "jitter": path.jitter, "loss": path.loss, "seed": 1}
    connection = {"expected": path.delay or NO_DELAY} if declared else late
    document = {
        "format": "hapticmech-scene/1",
        "name": "held_body",
        "links": [
            {
                "name": "body",
                "joint": {"name": "flight", "type": "free"},
                "inertial": {"mass": 0.8, "inertia": {"ixx": 1e-3, "iyy": 1e-3, "izz": 1e-3}},
            }
        ],
        "operational_points": [
            {"name": name, "link": "body", "origin": {"xyz": [x, 0.0, 0.0]}}
            for name, x in ((NEAR, REACH), (FAR, -REACH))
        ],
        "simulation": {"period": period},
        "hand": near,
        "controller": {"passivity": {"slack": slack}},
        "hands": [{"point": NEAR}, {"point": FAR, "hand": far, "connection": connection}],
    }
    return scene_from_document(document)


def simulated(
    path: Path, period: float = 1e-3, slack: float = SLACK_J
) -> tuple[Array, Array, float]:
    """Return what a session over the same path says of :meth:`Seen.moved`, and of E_h in sum, J.

    Args:
        path: between the far device and the rest.
        period: of control, s.
        slack: of passivity control at each port, J.
    """
    scene = held_body(path, False, period, slack)
    rows = SharedSession(scene).run(round((WAITS_S + MOVES_S + SETTLES_S) / period))
    device, total = scene.device, np.zeros(len(rows[NEAR]))
    inertia = np.array([device.mass] * 3 + [device.inertia] * 3)
    for run in rows.values():
        total += run["actuators"] + 0.5 * np.sum(inertia * run["device_twist"] ** 2, axis=1)
    x = rows[NEAR]["device_position"][:, 0]
    return rows[NEAR]["time"], x - x[0], float(total.min())


def watched(
    path: Path,
    out: FilePath,
    period: float = 1e-3,
    slack: float = SLACK_J,
    settings: Mapping[str, object] = MappingProxyType(PATIENT),
    domain: int = 7,
    to_the_end: bool = False,
) -> Seen:
    """Return what both go through over a path, with the loss of it, and of the far device.

    Where the machine stalled before the cut, so that a hand let go or that periods of the motion
    were dropped, it is done again.

    Args:
        path: between the far device and the rest.
        out: folder for scene, logs and what was watched.
        period: of control, s.
        slack: of passivity control at each port, J.
        settings: ``node.parameter`` or ``parameter``, of all nodes.
        domain: ROS_DOMAIN_ID.
        to_the_end: whether it is done again also where the near hand let go after the cut.

    Raises:
        BenchError: rendering was interrupted, or late, in every try; or a device does not render.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = out / "held_body.yaml"
    document = document_of(held_body(path, True, period, slack))
    file.write_text(json.dumps(document), encoding="utf-8")
    processes = of_two_users(str(file), NEAR, FAR, settings)
    sides = {NEAR: REST, FAR: DEVICE}
    for _ in range(TRIES):
        with (
            EmulatedNetwork(path, path) as network,
            SplitGraph(network, out, processes, domain, sides) as graph,
        ):
            events = [
                (CUT_S, lambda: network.set(Path(out=True))),
                (MENDED_S, lambda: network.set(path)),
                (KILLED_S, lambda: graph.kill_nodes("device")),
            ]
            made = run_for(graph, END_S, events)
            # On a busy machine what was killed starts for longer.
            graph.wait()
            time.sleep(RENDERED_S)
            found = graph.watched()
        seen = Seen(found[NEAR], found[FAR], *made)
        later = seen.held(seen.cut, seen.killed + RETURNS_S)
        if seen.unbroken and seen.kept_up(period) and (later == 1.0 or not to_the_end):
            return seen
    raise BenchError(f"rendering stopped or was late in each of {TRIES} tries: too busy a machine")


def run(quick: bool, out: FilePath) -> list[Figure]:
    """Return the figures of this part.

    Args:
        quick: two trials instead of all.
        out: folder for logs and what was watched.

    Raises:
        NoNetworkError: no network can be emulated here.
    """
    figures: list[Figure] = []
    for delay, kind, slack in QUICK if quick else TRIALS:
        also = f", slack of {1e3 * slack:g} mJ" if slack != SLACK_J else ""
        name = f"{1e3 * delay:g} ms, {kind}{also}"
        folder, path = f"users_{name.replace(' ', '_')}", Path(delay, **KINDS[kind])
        try:
            seen = watched(path, out / folder, slack=slack)
        except BenchError as error:
            figures.append(unmeasured(name, str(error)))
            continue
        if slack == SLACK_J:
            figures += _of_motion(name, path, seen)
        figures += _of_energies(name, path, slack, seen)
    return figures


def _of_motion(name: str, path: Path, seen: Seen) -> Iterator[Figure]:
    (time, moved), (known, expected, _) = seen.moved(), simulated(path)
    common = time < known[-1]
    off = 1e3 * float(np.abs(moved - np.interp(time, known, expected))[common].max())
    way, error = 1e3 * RESTS_AT, 1e3 * REST_ERROR * RESTS_AT
    rests = 1e3 * seen.rests_at(seen.cut, 1.0)
    yield Figure(f"{name}: moves the other by", rests, "mm", way + error, way - error, 1)
    yield Figure(f"{name}: off a session's motion by", off, "mm", MOTION_ERROR * way, None, 1)
    zero = 1e3 * seen.far.zero_after(seen.cut, seen.mended)
    within = 1e3 * (path.delay * (1.0 + path.jitter) + MARGIN_S)
    yield Figure(f"{name}: cut, zero force within", zero, "ms", within, None, 1)
    for what, start, end, most in (
        ("cut", seen.cut, seen.mended, BACK_S),
        ("killed", seen.killed, seen.killed + RETURNS_S, None),
    ):
        left = 1e3 * abs(seen.rests_at(start + RETURNS_S))
        again = seen.far.back_after(seen.mended if what == "cut" else start)
        after = f"{name}: {what}, "
        yield Figure(f"{after}the other is held", seen.held(start, end), "", None, HELD, 1)
        yield Figure(f"{after}left of its way", left, "mm", 2.0 * error, None, 1)
        yield Figure(f"{after}renders again within", again, "s", most, None, 1)


def _of_energies(name: str, path: Path, slack: float, seen: Seen) -> Iterator[Figure]:
    near, far, total = seen.energies()
    yield Figure(f"{name}: least E_h, near", near, "J", None, ENERGY_J, 1)
    yield Figure(f"{name}: least E_h, far", far, "J", None, ENERGY_J, 1)
    expected = simulated(path, slack=slack)[-1]
    note = f"{expected:.2g} J in a session"
    yield Figure(f"{name}: E_h in sum", total, "J", None, expected - SUM_J, 1, note)
