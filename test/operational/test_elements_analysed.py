# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What acts in joints enters the free acceleration, however it is found."""

import copy

import numpy as np
import pytest

from hapticmech_ros.layout import OPERATIONAL_MODEL
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.operational.analysis import Analyser
from hapticmech_ros.scene import scene_from_document
from oracles.generator import random_mechanism
from oracles.implementations import apart
from oracles.mechanism.mechanism import ReadableMechanism
from oracles.running import with_start


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_free_acceleration(seed, planar):
    base = random_mechanism(seed, planar)
    document = copy.deepcopy(base.document)
    for link in document["links"]:
        if link["joint"]["type"] in ("revolute", "prismatic"):
            link["joint"] |= {"stiffness": 3.0, "effort": 2.0, "friction": 1.0}
    ends = {"a": {"link": "link4"}, "b": {"link": "world"}}
    document["springs"] = [{"name": "s", "stiffness": 5.0, "damping": 1.0} | ends]
    scene = scene_from_document(with_start(document, base.q, base.v))
    readable, mechanism = ReadableMechanism(scene), Mechanism(scene)
    active = readable.initially_active
    terms = readable.evaluate(base.q, base.v, active)
    point = terms.points[0]
    expected = point.jacobian @ terms.acceleration(np.zeros(readable.nv))[0] + point.drift
    analyser = Analyser(mechanism)
    seen = analyser.observe(base.q, base.v, active).model
    known = analyser.analyse(mechanism.evaluate(base.q, base.v, active)).free_acceleration
    # Closures magnify rounding by their condition, up to 1e3 here.
    assert apart(known, expected) < 1e-9
    assert apart(seen[OPERATIONAL_MODEL.slice("free_acceleration")], expected) < 1e-9
