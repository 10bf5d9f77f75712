# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Topics that had another name in earlier versions, and bags that hold them."""

from __future__ import annotations

import re

from hapticmech_ros.bag.reader import BagReader
from hapticmech_ros.errors import BagError

# Former name -> present name; a name of a point or link stands for itself.
FORMER = {
    "device/held_cf": "device/hand_cf/persistent",
    "device/servo_gain": "device/local_feedback_gain",
    r"mechanism/([^/]+)/held_cf": r"mechanism/\1/external_cf/persistent",
    r"mechanism/([^/]+)/grasp": r"mechanism/\1/set_operational_point",
    r"mechanism/([^/]+)/grasped": r"mechanism/\1/operational_point",
    r"analysis/([^/]+)/rendering": r"analysis/\1/operational_model",
}


def present_name(name: str) -> str:
    """Return the present name of a topic, its namespace kept; empty if it has not changed."""
    for former, present in FORMER.items():
        found = re.fullmatch(f"(.*/){former}(/[^/]+)?", name)
        if found:
            groups = [group or "" for group in found.groups()]
            return groups[0] + found.expand(present.replace(r"\1", r"\2")) + groups[-1]
    return ""


def refuse_former_topics(bag: BagReader) -> None:
    """Check that a bag holds no topic under a former name.

    Raises:
        BagError: it does; names each with its present name.
    """
    renamed = {name: present_name(name) for name in sorted(bag.topics)}
    listed = ", ".join(f"{name} is {now} now" for name, now in renamed.items() if now)
    if listed:
        rule = "was recorded before these topics were renamed"
        raise BagError(f"bag {bag.path}: {rule}: {listed}; docs/notation.md lists what has changed")
