# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Push on a running mechanism from your own node: 0.4 N in y for three seconds.

Start a graph first (`hapticmech run five_bar`), then run this with the same Python.
"""

import rclpy
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

RATE_HZ = 100.0
DURATION_S = 3.0


class Push(Node):
    """Publishes a wrench and watches the operational point."""

    def __init__(self) -> None:
        super().__init__("push")
        self.point: PoseStamped | None = None
        self.sent = 0
        self.push = self.create_publisher(WrenchStamped, "mechanism/handle/external_cf", 10)
        self.create_subscription(PoseStamped, "mechanism/handle/measured_cp", self.on_pose, 10)
        self.create_timer(1.0 / RATE_HZ, self.publish)

    def on_pose(self, message: PoseStamped) -> None:
        """Keep the last pose of the operational point."""
        self.point = message

    def publish(self) -> None:
        """Publish the wrench; it expires 0.2 s after the last message."""
        if self.push.get_subscription_count() == 0:
            return
        message = WrenchStamped()
        message.header.frame_id = "world"
        message.header.stamp = self.get_clock().now().to_msg()
        message.wrench.force.y = 0.4
        self.push.publish(message)
        self.sent += 1
        if self.sent % 50 == 0 and self.point is not None:
            position = self.point.pose.position
            print(f"handle at x = {1e3 * position.x:.1f} mm, y = {1e3 * position.y:.1f} mm")


def main() -> None:
    """Push until the time is over."""
    rclpy.init()
    node = Push()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while rclpy.ok() and node.sent < DURATION_S * RATE_HZ:
        executor.spin_once(timeout_sec=0.1)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
