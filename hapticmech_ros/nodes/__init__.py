"""The four nodes, their messages and their loop: the only folder that imports rclpy."""
