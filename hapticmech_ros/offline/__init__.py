"""Analysis after the fact: Λ_h⁻¹, spectrum and count over a whole recording, without ROS."""

from hapticmech_ros.offline.analysis import AnalysedStates, analyse_states
from hapticmech_ros.offline.states import RecordedStates, states_from_bag

__all__ = ["AnalysedStates", "RecordedStates", "analyse_states", "states_from_bag"]
