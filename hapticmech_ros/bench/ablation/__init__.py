"""Ablation: what each feature of a scene costs in a tick, and what one that is not used costs."""

from hapticmech_ros.bench.ablation.ladder import ladder
from hapticmech_ros.bench.ablation.pairs import Pair, pairs
from hapticmech_ros.bench.ablation.variant import Variant

__all__ = ["Pair", "Variant", "ladder", "pairs"]
