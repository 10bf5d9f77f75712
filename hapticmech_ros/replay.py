# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Selective replay: a recorded session's inputs, fed into a live graph in lockstep.

What comes out is recorded, and can be compared with what was recorded then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from hapticmech_ros.bag.reader import BagReader, refuse_former_topics
from hapticmech_ros.errors import BagError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.lockstep import LockstepRun, run_lockstep
from hapticmech_ros.wire.topics import DEVICE_STATE, DIAGNOSTICS


def replay(
    run: LockstepRun, environment: Mapping[str, str], asked_to_stop: Callable[[], bool]
) -> int:
    """Run ``run`` with what its bag says it was recorded with; return the number of ticks.

    An empty scene is the recorded one, an empty namespace that of the recorded device.

    Raises:
        BagError: no bag, nothing of a device or a scene in it, or topics under former names.
        LockstepError: the graph did not come to the end.
    """
    if run.feed_from is None:
        raise BagError("a replay needs a bag")
    with BagReader(run.feed_from) as bag:
        refuse_former_topics(bag)
        scene = run.scene or _scene(bag)
        held = load_scene(scene).held_points
        if len(held) > 1:
            rule = f"its scene has the hands {', '.join(held)}, and a replay feeds one alone"
            raise BagError(f"bag {bag.path}: {rule}")
        namespace = run.namespace or _namespace(bag)
    return run_lockstep(replace(run, scene=scene, namespace=namespace), environment, asked_to_stop)


def _namespace(bag: BagReader) -> str:
    """Return the namespace of the one device in a bag."""
    tail = f"/{DEVICE_STATE.name}"
    devices = [name.removesuffix(tail) for name in bag.topics if name.endswith(tail)]
    if len(devices) != 1:
        rule = f"a replay needs one device (found {len(devices)}); name it by --namespace"
        raise BagError(f"bag {bag.path}: {rule}")
    return devices[0].strip("/")


def _scene(bag: BagReader) -> str:
    """Return the scene that the nodes said they ran."""
    if DIAGNOSTICS.name in bag.topics:
        for item in bag.messages(DIAGNOSTICS.name):
            for status in item.message.status:
                if status.hardware_id:
                    return _found(str(status.hardware_id), bag.path)
    raise BagError(f"bag {bag.path}: does not say which scene was run; name it by --scene")


def _found(scene: str, bag: Path) -> str:
    if scene.endswith((".yaml", ".yml")) and not Path(scene).is_file():
        raise BagError(f"bag {bag}: was recorded of {scene}, which is not here; give --scene")
    return scene
