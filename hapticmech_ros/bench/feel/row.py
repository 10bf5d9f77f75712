"""One line of the feel benchmark's results."""

from __future__ import annotations

from dataclasses import dataclass

from hapticmech_ros.bench.feel.impedance import Felt


@dataclass(frozen=True, slots=True)
class Row:
    """What is felt along one direction of a scene.

    Attributes:
        scene: its name.
        loop: what closes the force channel: device or controller.
        delay: periods from measuring to acting.
        felt: along the direction.
    """

    scene: str
    loop: str
    delay: int
    felt: Felt

    def document(self) -> dict[str, object]:
        """Return the row as plain lists and numbers."""
        found = self.felt
        return {
            "scene": self.scene,
            "loop": self.loop,
            "delay_periods": self.delay,
            "direction": found.direction.tolist(),
            "mass": found.mass,
            "frequencies_hz": found.frequencies.tolist(),
            "ratio_real": found.ratio.real.tolist(),
            "ratio_imaginary": found.ratio.imag.tolist(),
            "predicted_real": found.predicted.real.tolist(),
            "predicted_imaginary": found.predicted.imag.tolist(),
            "steady_real": found.steady.real.tolist(),
            "steady_imaginary": found.steady.imag.tolist(),
            "error_to_10_hz": found.error(10.0),
            "error_to_30_hz": found.error(30.0),
            "steady_error_to_10_hz": found.steady_error(10.0),
            "model_error_to_30_hz": found.model_error(30.0),
            "bandwidth_hz": found.bandwidth,
        }
