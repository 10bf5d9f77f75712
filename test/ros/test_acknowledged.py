"""The last messages of a publisher: others have them before it is destroyed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
from std_msgs.msg import String

from hapticmech_ros.graph import private_environment, stop_process
from hapticmech_ros.nodes.acknowledged import wait_until_acknowledged
from ros.harness import RELIABLE, Peer

pytestmark = pytest.mark.ros
TOPIC = "last_words"
# A subscriber in a process of its own, which can be stopped.
SUBSCRIBER = f"""
import rclpy
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("subscriber")
node.create_subscription(String, "{TOPIC}", lambda message: None, 10)
while rclpy.ok():
    rclpy.spin_once(node, timeout_sec=0.5)
"""


def test_what_was_acknowledged_arrives_though_its_publisher_is_gone(domain: int) -> None:
    hears, speaks = Peer(domain), Peer(domain)
    try:
        heard = hears.listen(TOPIC, String)
        publisher = speaks.publisher(TOPIC, String, RELIABLE)
        for number in range(100):
            publisher.publish(String(data=str(number)))
        # Others of a node's entities have nothing to say.
        assert wait_until_acknowledged([object(), publisher], within_s=5.0)
        speaks.node.destroy_publisher(publisher)
        hears.until(lambda: len(heard) == 100, "all messages of a publisher that is gone")
        assert [message.data for message in heard] == [str(number) for number in range(100)]
    finally:
        hears.close()
        speaks.close()


def test_a_subscriber_that_stands_still_is_not_waited_for_long(domain: int, peer: Peer) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", SUBSCRIBER], env=private_environment(domain), text=True
    )
    try:
        publisher = peer.publisher(TOPIC, String, RELIABLE)
        publisher.publish(String(data="heard"))
        assert wait_until_acknowledged([publisher], within_s=5.0)
        os.kill(process.pid, signal.SIGSTOP)
        publisher.publish(String(data="not heard"))
        assert not wait_until_acknowledged([publisher])
        os.kill(process.pid, signal.SIGCONT)
        assert wait_until_acknowledged([publisher], within_s=5.0)
    finally:
        os.kill(process.pid, signal.SIGCONT)
        stop_process(process)
