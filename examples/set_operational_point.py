# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Move the point you hold on a running mechanism: to a link, at an offset in its frame.

Start a graph first (`hapticmech run five_bar`), then:
python examples/set_operational_point.py link1 0.02 0.01 0
"""

import sys

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile

WAIT_S = 5.0


def main() -> int:
    """Publish the point, and wait until the mechanism confirms it; 1 if it does not."""
    link, *offset = sys.argv[1:] or ["link1", "0.02", "0.01", "0"]
    rclpy.init()
    node = rclpy.create_node("grasp")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    grasp = node.create_publisher(PoseStamped, "mechanism/handle/set_operational_point", 10)
    told: list[PoseStamped] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(
        PoseStamped, "mechanism/handle/operational_point", told.append, latched
    )
    message = PoseStamped()
    message.header.frame_id = link
    place = message.pose.position
    place.x, place.y, place.z = map(float, [*offset, 0.0, 0.0, 0.0][:3])
    end = node.get_clock().now().nanoseconds + round(WAIT_S * 1e9)
    sent = False
    while node.get_clock().now().nanoseconds < end:
        executor.spin_once(timeout_sec=0.1)
        if not sent and told and grasp.get_subscription_count() > 0:
            grasp.publish(message)
            sent = True
        elif told and told[-1].header.frame_id == link and told[-1].pose.position == place:
            print(f"held on {link}, at {place.x:g} {place.y:g} {place.z:g} m")
            code = 0
            break
    else:
        print("the mechanism did not take it: it says why in its log", file=sys.stderr)
        code = 1
    node.destroy_node()
    rclpy.try_shutdown()
    return code


if __name__ == "__main__":
    sys.exit(main())
