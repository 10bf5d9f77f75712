"""Memory of processes over time: samples, and what they say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from hapticmech_ros.bench.memory.resident import resident
from hapticmech_ros.bench.memory.trend import Trend, trend


@dataclass(slots=True)
class Watch:
    """Samples of some processes.

    Attributes:
        times: s since the first sample.
        resident: by process, bytes at these times.
        private: the same of pages that it alone has and has written to; NaN where unknown.
    """

    times: list[float] = field(default_factory=list)
    resident: dict[str, list[float]] = field(default_factory=dict)
    private: dict[str, list[float]] = field(default_factory=dict)

    def look(self, time: float, processes: Mapping[str, int]) -> bool:
        """Take a sample of processes by name (ids); False, and nothing, if one is no more."""
        found = {name: resident(pid) for name, pid in processes.items()}
        if None in found.values():
            return False
        self.times.append(time)
        for name, size in found.items():
            if size is not None:
                self.resident.setdefault(name, []).append(size.resident)
                self.private.setdefault(name, []).append(size.private)
        return True

    def trends(self, warm_up: float) -> dict[str, Trend]:
        """Return the trend of each process's resident size.

        Raises:
            InvalidInputError: too few samples.
        """
        return {name: trend(self.times, sizes, warm_up) for name, sizes in self.resident.items()}


@dataclass(frozen=True, slots=True)
class Grown:
    """What was seen of one process.

    Attributes:
        where: ``session`` or ``graph``.
        name: of the process.
        ticks: that it did, about; of nodes, periods.
        trend: of its resident size.
        private_first, private_last: pages that it alone wrote to, bytes, after the warm-up and at
            the end; None where the kernel does not tell.
    """

    where: str
    name: str
    ticks: int
    trend: Trend
    private_first: float | None
    private_last: float | None


def grown(where: str, watch: Watch, ticks: int, warm_up: float) -> tuple[Grown, ...]:
    """Return what was seen of each process of a watch."""
    return tuple(
        Grown(
            where,
            name,
            ticks,
            found,
            _known(watch.private[name][-found.samples]),
            _known(watch.private[name][-1]),
        )
        for name, found in watch.trends(warm_up).items()
    )


def _known(size: float) -> float | None:
    return None if size != size else size
