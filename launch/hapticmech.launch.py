"""The graph of nodes, for ROS 2 installations with launch.

ros2 launch hapticmech_ros hapticmech.launch.py scene:=five_bar composed:=true rviz:=true
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = "hapticmech_ros"
NODES = ("haptic_device", "mechanism_simulator", "nullspace_analyser", "teleoperation_controller")
ARGUMENTS = (
    ("scene", "five_bar", "shipped scene, or path of a YAML file"),
    ("control_rate", "0.0", "samples per second, Hz; 0.0: the scene's own"),
    ("network_delay", "0.0", "one way between device and controller, designed for, s"),
    ("operational_point", "", "where the user holds; empty: the scene's first point"),
    ("namespace", "", "put nodes and topics under this name"),
    ("composed", "false", "all four nodes in one process"),
    ("view", "true", "markers, frames and robot_description as well"),
    ("rviz", "false", "open RViz on them"),
    ("record", "", "folder of a bag to record everything into; empty: none"),
    ("use_sim_time", "false", "follow /clock"),
    ("respawn", "false", "start a node again that has ended by itself"),
)
RESPAWN_DELAY_S = 0.5


def generate_launch_description():
    given = {name: LaunchConfiguration(name) for name, _, _ in ARGUMENTS}
    parameters = {
        "scene": ParameterValue(given["scene"], value_type=str),
        "operational_point": ParameterValue(given["operational_point"], value_type=str),
        "control_rate": ParameterValue(given["control_rate"], value_type=float),
        "network_delay": ParameterValue(given["network_delay"], value_type=float),
        "use_sim_time": ParameterValue(given["use_sim_time"], value_type=bool),
    }

    def node(executable, condition):
        return Node(
            package=PACKAGE,
            executable=executable,
            namespace=given["namespace"],
            parameters=[parameters],
            output="screen",
            respawn=given["respawn"],
            respawn_delay=RESPAWN_DELAY_S,
            condition=condition,
        )

    separate, together = UnlessCondition(given["composed"]), IfCondition(given["composed"])
    layout = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "rviz", "hapticmech.rviz"])
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(n, default_value=d, description=t) for n, d, t in ARGUMENTS),
            # First: if it is not installed, nothing has been started yet.
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", layout],
                condition=IfCondition(given["rviz"]),
            ),
            *(node(name, separate) for name in NODES),
            node("composed", together),
            node("scene_viewer", IfCondition(given["view"])),
            ExecuteProcess(
                cmd=["hapticmech", "bag", "record", "--all", "--out", given["record"]],
                output="screen",
                condition=IfCondition(PythonExpression(["'", given["record"], "' != ''"])),
            ),
        ]
    )
