"""What the speed benchmark does: scenes, peers, and how much is spent on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmarks.speed.contender import Peer
from benchmarks.speed.exudyn_peer import ExudynPeer
from benchmarks.speed.mujoco_peer import MujocoPeer
from benchmarks.speed.own_peer import DEFAULT, OwnPeer
from benchmarks.speed.pinocchio_peer import PinocchioPeer
from benchmarks.speed.problems import Problem, problems
from benchmarks.speed.race import Effort
from hapticmech_ros.errors import InvalidInputError

PEERS = ("mujoco", "pinocchio", "exudyn")
MOST_REPEATS = 1000


@dataclass(frozen=True, slots=True)
class Plan:
    """One run of the benchmark.

    Attributes:
        problems: scenes, in order.
        peers: ours first.
        absent: of the peers that were asked for, name and why it cannot run here.
        effort: repeats and budgets.
        smoke: check equality and time nothing.
        all_scenes: whether scenes were not chosen; scaling and ticks are measured only then.
    """

    problems: tuple[Problem, ...]
    peers: tuple[Peer, ...]
    absent: Mapping[str, str]
    effort: Effort
    smoke: bool
    all_scenes: bool


def plan(
    scenes: Sequence[str] = (),
    peers: Sequence[str] = (),
    integrators: Mapping[str, tuple[float, ...]] = DEFAULT,
    repeats: int = 5,
    quick: bool = False,
    smoke: bool = False,
) -> Plan:
    """Return a plan.

    Args:
        scenes: by name, all if empty; with ``quick`` or ``smoke`` all that are not large.
        peers: beside ours, by name; all if empty.
        integrators: of ours, and their steps in units of a scene; by order if empty.
        repeats: timed runs of each result.
        quick: few steps, short runs.
        smoke: no times.

    Raises:
        InvalidInputError: unknown scene, peer or integrator, or repeats out of range.
    """
    for name in peers:
        if name not in PEERS:
            raise InvalidInputError("peer", name, f"must be one of {list(PEERS)}")
    if not 1 <= repeats <= MOST_REPEATS:
        raise InvalidInputError("repeats", repeats, f"must be from 1 to {MOST_REPEATS}")
    chosen = problems(scenes)
    if not scenes and (quick or smoke):
        chosen = tuple(problem for problem in chosen if not problem.large)
    all_peers = {peer.name: peer for peer in _peers()}
    wanted = [all_peers[name] for name in peers or PEERS]
    absent = {peer.name: reason for peer in wanted if (reason := peer.missing())}
    ready = [peer for peer in wanted if peer.name not in absent]
    effort = Effort(repeats, 0.05, 1.0, True) if quick else Effort(repeats)
    return Plan(chosen, (OwnPeer(integrators), *ready), absent, effort, smoke, not scenes)


def _peers() -> tuple[Peer, ...]:
    return MujocoPeer(), PinocchioPeer(), ExudynPeer()
