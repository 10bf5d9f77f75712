"""Memory: whether session and nodes stay as large as they are, for an hour and for good."""

from hapticmech_ros.bench.memory.resident import Resident, resident
from hapticmech_ros.bench.memory.trend import Trend, trend

__all__ = ["Resident", "Trend", "resident", "trend"]
