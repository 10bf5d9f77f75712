# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is felt over a graph of real nodes, in four processes."""

import numpy as np

from hapticmech_ros import load_scene
from hapticmech_ros.analysis.transparency import FREQUENCIES_HZ, felt_over_graph
from ros.harness import RATE


def test_a_graph_is_felt_as_heavy_as_the_mechanism() -> None:
    """Twelve times the device, with the error of the law that the model predicts.

    Late by a period and not corrected, it would be off by 100 %.
    """
    found = felt_over_graph(load_scene("two_link", RATE), "lockstep")
    assert len(found) == 2
    for one in found:
        assert one.frequencies.tolist() == list(FREQUENCIES_HZ)
        off = np.abs(one.ratio / one.steady - 1.0)
        assert np.median(off) < 0.03
        assert off[one.frequencies <= 10].max() < 0.03
        # What the law itself is off at this rate; at 500 Hz that is a tenth.
        assert one.steady_error(10.0) < 0.06
