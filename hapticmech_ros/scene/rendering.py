# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What renders the mechanism in a scene, beside device, hand and gains."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from hapticmech_ros.scene.part import NonNegative, Part, Positive


class Perception(Part):
    """Which directions count as rigid, in s = sqrt(mu) (docs/notation.md).

    Control weighs directions smoothly from 1 at ``s_on`` to 0 at ``s_off``; the reported count
    switches on below ``s_on`` and off above ``s_off``, each after ``dwell``.

    Attributes:
        s_on: below which a direction is rigid.
        s_off: above which it is free; above ``s_on``.
        dwell: s.
    """

    s_on: Annotated[Positive, Field(lt=1.0)] = 0.02
    s_off: Annotated[Positive, Field(lt=1.0)] = 0.05
    dwell: NonNegative = 0.005


class Experiment(Part):
    """The scene's experiment.

    Attributes:
        duration: s, after the hand starts.
    """

    duration: Positive = 5.0
