# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph of nodes, for ROS 2 installations with launch.

ros2 launch hapticmech_ros hapticmech.launch.py scene:=five_bar composed:=true rviz:=true

Several points to hold, lockstep, a device named for a point, and another device in one process with
the other nodes are what `hapticmech run` starts: launch starts that alone.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from hapticmech_ros.errors import SceneError
from hapticmech_ros.loading import load_scene

PACKAGE = "hapticmech_ros"
NODES = ("haptic_device", "mechanism_simulator", "nullspace_analyser", "teleoperation_controller")
ARGUMENTS = (
    ("scene", "five_bar", "shipped scene, or path of a YAML, URDF, MJCF or SDF file"),
    (
        "device",
        "simulated",
        "what drives the device: simulated, haply or relay (docs/drivers.md); of several points to "
        "hold also POINT=haply, any number, separated by commas",
    ),
    ("control_rate", "0.0", "samples per second, Hz; 0.0: the scene's own"),
    ("network_delay", "0.0", "one way between device and controller, designed for, s"),
    ("operational_point", "", "where the user holds; empty: the scene's first point"),
    (
        "hold",
        "",
        "several points, separated by commas: a device each, in its namespace; empty: those of the "
        "scene's hands",
    ),
    ("namespace", "", "put nodes and topics under this name"),
    ("composed", "false", "all four nodes in one process"),
    ("params_file", "", "ROS parameter file for all nodes; empty: none"),
    ("frame_prefix", "auto", "prefix of the viewer's frames; auto: the namespace and a slash"),
    ("transport", "auto", "auto: between processes of this host directly; or middleware"),
    ("view", "true", "markers, frames and robot_description as well"),
    ("rviz", "false", "open RViz on them"),
    (
        "live",
        "false",
        "a page for this machine's browser on which the mechanism is dragged as well",
    ),
    ("record", "", "folder of a bag to record everything into; empty: none"),
    ("storage", "mcap", "of the bag: mcap or sqlite3"),
    ("use_sim_time", "false", "follow /clock"),
    ("lockstep", "false", "advance by messages, as fast as possible, with repeatable bits"),
    ("duration", "0.0", "lockstep: seconds to simulate; 0.0: until Ctrl-C"),
    ("respawn", "false", "start a node again that has ended by itself"),
)
DRIVERS = {"simulated": "haptic_device", "haply": "haply_device", "relay": "relay_device"}
YES, NO = ("true", "1", "yes", "on"), ("false", "0", "no", "off")
RESPAWN_DELAY_S = 0.5


def is_on(given, name):
    """Return whether an argument says yes; what says neither is an error."""
    word = given[name].strip().lower()
    if word not in (*YES, *NO):
        raise ValueError(f"{name}:={given[name]}: must be true or false")
    return word in YES


def devices_of(given):
    """Return what drives devices, and where; a device that there is none of is an error."""
    devices = [word.strip() for word in given["device"].split(",")]
    for word in devices:
        if word.rpartition("=")[2] not in DRIVERS:
            raise ValueError(f"device:={word}: must be one of {', '.join(DRIVERS)}")
    return devices


def own_nodes(given):
    """Yield the nodes of one operational point, and who watches them."""
    parameters = {
        "scene": ParameterValue(given["scene"], value_type=str),
        "operational_point": ParameterValue(given["operational_point"], value_type=str),
        "transport": ParameterValue(given["transport"], value_type=str),
        "control_rate": float(given["control_rate"]),
        "network_delay": float(given["network_delay"]),
        "use_sim_time": is_on(given, "use_sim_time"),
    }
    files = [given["params_file"]] if given["params_file"] else []
    driver = DRIVERS[devices_of(given)[-1]]
    executables = ["composed"] if is_on(given, "composed") else [driver, *NODES[1:]]
    if is_on(given, "view"):
        executables.append("scene_viewer")
    if is_on(given, "live"):
        executables.append("live_page")
    for executable in executables:
        own = {}
        if executable == "scene_viewer":
            own["frame_prefix"] = ParameterValue(given["frame_prefix"], value_type=str)
        if executable == "live_page":
            own["transport"] = "middleware"
        yield Node(
            package=PACKAGE,
            executable=executable,
            namespace=given["namespace"],
            parameters=[{**parameters, **own}, *files],
            output="screen",
            respawn=is_on(given, "respawn"),
            respawn_delay=RESPAWN_DELAY_S,
        )
    if given["record"]:
        command = ["hapticmech", "bag", "record", "--all", "--out", given["record"]]
        command += ["--storage", given["storage"], "--transport", given["transport"]]
        yield ExecuteProcess(cmd=command, output="screen")


def command_of(given):
    """Return the `hapticmech run` that does what is given."""
    command = ["hapticmech", "run", given["scene"], "--transport", given["transport"]]
    command += [word for device in devices_of(given) for word in ("--device", device)]
    points = [name.strip() for name in given["hold"].split(",") if name.strip()]
    for point in points or [given["operational_point"]]:
        command += ["--hold", point] if point else []
    for name in ("namespace", "params_file", "record"):
        command += [f"--{name.replace('_', '-')}", given[name]] if given[name] else []
    if given["record"]:
        command += ["--storage", given["storage"]]
    if float(given["control_rate"]):
        command += ["--control-rate", given["control_rate"]]
    if float(given["network_delay"]):
        command += ["--network-delay", f"{given['network_delay']}s"]
    if is_on(given, "lockstep"):
        # It runs no viewer, by a clock of its own.
        command += ["--lockstep", "--duration", given["duration"]]
    else:
        for name in ("view", "live", "use_sim_time", "respawn"):
            command += [f"--{name.replace('_', '-')}"] if is_on(given, name) else []
        command += ["--set", f"scene_viewer.frame_prefix={given['frame_prefix']}"]
    return command + (["--composed"] if is_on(given, "composed") else [])


def hands_of(scene):
    """Return the points that a scene's hands hold; of a scene that is refused none."""
    try:
        return [entry.point for entry in load_scene(scene).hands]
    except SceneError:
        return []  # the nodes say what is wrong with it


def start(context):
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    started = []
    # First: if it is not installed, nothing has been started yet.
    if is_on(given, "rviz"):
        share = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "rviz"])
        layout = PathJoinSubstitution([share, "hapticmech.rviz"])
        started.append(Node(package="rviz2", executable="rviz2", arguments=["-d", layout]))
    if not (given["hold"] or given["operational_point"]):
        given["hold"] = ",".join(hands_of(given["scene"]))
    devices = devices_of(given)
    # The executable `composed` has the simulated device in it.
    another = devices != ["simulated"] and is_on(given, "composed")
    named = any("=" in device for device in devices)
    if "," in given["hold"] or is_on(given, "lockstep") or another or named:
        return [*started, ExecuteProcess(cmd=command_of(given), output="screen")]
    if given["hold"] and not given["operational_point"]:
        given["operational_point"] = given["hold"].strip()
    return [*started, *own_nodes(given)]


def generate_launch_description():
    arguments = (DeclareLaunchArgument(n, default_value=d, description=t) for n, d, t in ARGUMENTS)
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])
