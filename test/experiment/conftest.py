# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A run of the paper's experiment, once for all tests, and bags made of its samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from hapticmech_ros.control import DeviceMeasurement, PointMeasurement
from hapticmech_ros.control.measurements import (
    flat_device,
    flat_operational_model,
    operational_model_of,
)
from hapticmech_ros.experiment import ExperimentRecord, run_session
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Sample, Session
from hapticmech_ros.wire.messages import (
    ENERGY_NAMES,
    DeviceStateMessage,
    MechanismEnergy,
    OperationalModelMessage,
)

DURATION = 2.5
EPOCH_NS = 1_700_000_000_123_456_789
VIEW_EVERY = 10


@pytest.fixture(scope="session")
def scene() -> Scene:
    """Return the five-bar at 500 Hz, which halves the time that the tests take."""
    return load_scene("five_bar").stepped(period=0.002)


@pytest.fixture(scope="session")
def session_record(scene: Scene) -> ExperimentRecord:
    return run_session(scene, DURATION)


@pytest.fixture(scope="session")
def samples(scene: Scene) -> list[tuple[Sample, tuple[float, float]]]:
    """Return the samples of the same run and the energies at them."""
    session = Session(scene)
    ticks = round((scene.hand.start_delay + DURATION) / session.period) + 1
    found = []
    for _ in range(ticks):
        sample = session.tick()
        state = sample.mechanism
        found.append((sample, session.simulator.mechanism.energy(state.q, state.v)))
    return found


@pytest.fixture(scope="session")
def messages(scene: Scene, samples: Any) -> list[tuple[str, str, int, Any]]:
    """Return topic, type, time (ns) and message of what a graph would have published."""
    return list(_messages(scene, samples))


BagMaker = Callable[..., Path]


@pytest.fixture
def make_bag(messages: list[tuple[str, str, int, Any]], tmp_path: Path) -> BagMaker:
    """Return a writer of bags of the run: storage, namespace, topics left out, a change to each."""

    def make(
        storage: str = "mcap",
        namespace: str = "",
        without: Sequence[str] = (),
        change: Callable[[str, int, Any], Any] = lambda topic, time_ns, message: message,
        extra: Sequence[tuple[str, str, int, Any]] = (),
    ) -> Path:
        path = tmp_path / f"bag_{len(list(tmp_path.iterdir()))}"
        store = get_typestore(Stores.ROS2_JAZZY)
        with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
            connections: dict[str, Any] = {}
            for topic, kind, time_ns, message in [*messages, *extra]:
                if topic in without:
                    continue
                name = topic if topic.startswith("/") else f"{namespace}/{topic}"
                if name not in connections:
                    connections[name] = writer.add_connection(name, kind, typestore=store)
                changed = change(topic, time_ns, message)
                if changed is not None:
                    # A bag's own times are of reception: later, and of no interest.
                    data = store.serialize_cdr(changed, kind)
                    writer.write(connections[name], time_ns + 400_000, data)
        return path

    return make


def _messages(scene: Scene, samples: list[tuple[Sample, tuple[float, float]]]) -> Any:
    types = get_typestore(Stores.ROS2_JAZZY).types
    vector = types["geometry_msgs/msg/Vector3"]

    def header(time_ns: int) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](*divmod(time_ns, 1_000_000_000))
        return types["std_msgs/msg/Header"](stamp, "world")

    def wrench(time_ns: int, six: np.ndarray) -> Any:
        inner = types["geometry_msgs/msg/Wrench"](
            vector(*map(float, six[:3])), vector(*map(float, six[3:]))
        )
        return types["geometry_msgs/msg/WrenchStamped"](header(time_ns), inner)

    def array(values: np.ndarray) -> Any:
        layout = types["std_msgs/msg/MultiArrayLayout"]([], 0)
        return types["std_msgs/msg/Float64MultiArray"](layout, values)

    wrenches = "geometry_msgs/msg/WrenchStamped"
    arrays, joints = "std_msgs/msg/Float64MultiArray", "sensor_msgs/msg/JointState"
    names = [link.joint.name for link in scene.links]
    for index, (sample, (kinetic, potential)) in enumerate(samples):
        t = EPOCH_NS + round(sample.time * 1e9)
        state = sample.mechanism
        measured = DeviceMeasurement(
            sample.device.measured_pose, sample.device.measured_twist, sample.hand_wrench
        )
        yield (
            "device/state",
            arrays,
            t,
            array(DeviceStateMessage.of(t, sample=flat_device(measured)).values),
        )
        state_message = types[joints](header(t), names, state.q.copy(), state.v.copy(), np.zeros(0))
        yield "mechanism/measured_js", joints, t, state_message
        point = PointMeasurement(sample.point.pose, sample.point.twist, sample.external_wrench)
        model = flat_operational_model(operational_model_of(sample.analysis), point)
        found = OperationalModelMessage.of(t, count=sample.count, operational_model=model)
        found.directions, found.commanded = sample.analysis.spectrum.s.size, True
        found.s[:] = sample.analysis.spectrum.s
        yield "analysis/handle/operational_model", arrays, t, array(found.values)
        if index % VIEW_EVERY == 0:
            part = wrench(t, sample.output.joint_constraint)
            yield "controller/joint_constraint_cf", wrenches, t, part
            account = state.account
            energy = MechanismEnergy.of(
                t,
                kinetic=kinetic,
                potential=potential,
                work_in=account.work_in,
                damping_loss=account.damping_loss,
                latch_loss=account.latch_loss,
                closure_error=state.closure_error,
                surplus=account.surplus,
                refined=account.refined,
                inaccurate=account.inaccurate,
            )
            yield "mechanism/energy", arrays, t, array(energy.values)


@pytest.fixture
def handmade() -> Callable[..., ExperimentRecord]:
    """Return a maker of small records: at rest, 1 s before and 9 s after the push, 100 Hz."""

    def make(**changes: Any) -> ExperimentRecord:
        times = np.arange(-100, 901) / 100.0
        n = times.size
        upright = np.tile((0.0, 0.0, 0.0, 1.0), (n, 1))
        fields: dict[str, Any] = {
            "scene": "five_bar",
            "point": "handle",
            "source": "session",
            "period": 0.01,
            "times": times,
            "device_position": np.zeros((n, 3)),
            "device_orientation": upright,
            "point_position": np.zeros((n, 3)),
            "point_orientation": upright,
            "hand_wrench": np.zeros((n, 6)),
            "wrench_times": times[::10],
            "constraint_wrench": np.zeros((n, 6))[::10],
            "analysis_times": times,
            "count": np.ones(n, dtype=int),
            "s": np.tile((0.5, 0.3, 0.0), (n, 1)),
            "expected_wrench": np.zeros((n, 6)),
            "energy_times": times[::10],
            "joint_times": times,
            "joint_positions": np.tile((1.9, -1.2, -1.84741566, 0.61326591), (n, 1)),
        }
        fields |= {name: np.zeros(times[::10].size) for name in ENERGY_NAMES}
        return ExperimentRecord(**{**fields, **changes})

    return make
