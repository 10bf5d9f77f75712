# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A network between two hosts that are none: two network namespaces and a forwarder between them.

Needs Linux, root (CAP_NET_ADMIN, CAP_SYS_ADMIN) and ``ip``; no kernel module beyond veth. The
device is in one namespace, the rest of the graph in the other; nothing gets out of either but
through the forwarder, which runs in a third one.
"""

from __future__ import annotations

import ctypes
import fcntl
import itertools
import json
import os
import shutil
import socket
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path as FilePath

from benchmarks.children import ROOT
from hapticmech_ros.errors import HapticMechError

DEVICE, REST = "device", "rest"
ADDRESSES = {DEVICE: "10.87.0.1", REST: "10.87.0.2"}
_LINK_ADDRESSES = {DEVICE: "02:00:00:00:87:01", REST: "02:00:00:00:87:02"}
_MTU = 1500
_SIOCETHTOOL = 0x8946
# Checksums are left to hardware that is not there: receivers would refuse what was forwarded.
_ETHTOOL_OFF = (0x17, 0x19, 0x1F, 0x24)
_FORWARDER = "benchmarks.reliability.forwarder"


@dataclass(frozen=True, slots=True)
class Path:
    """One direction of a network.

    Attributes:
        delay: s.
        jitter: share of it by which each packet is earlier or later, evenly spread.
        loss: share of the packets that do not arrive.
        reordered: share of them that are held back so that others overtake them.
        held: s, for which these are held back.
        out: whether nothing gets through; what is on its way still arrives.
    """

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    reordered: float = 0.0
    held: float = 0.005
    out: bool = False


class NoNetworkError(HapticMechError):
    """No network can be emulated here."""


def not_permitted() -> str:
    """Return why no network can be emulated here; empty if it can."""
    if sys.platform != "linux" or shutil.which("ip") is None:
        return "needs Linux and ip (iproute2)"
    if os.geteuid() != 0:
        return "needs root, for network namespaces"
    name = f"hm{os.getpid()}p"
    try:
        _ip("netns", "add", name)
        try:
            _ip("-n", name, "link", "add", "a0", "type", "veth", "peer", "name", "b0")
        finally:
            _ip("netns", "del", name)
    except RuntimeError as error:
        return f"no network namespaces, or no virtual Ethernet: {error}"
    return ""


class EmulatedNetwork:
    """Two namespaces and what is between them. Use as a context manager.

    Args:
        to_rest, to_device: the two directions, to begin with.

    Attributes:
        namespaces: names, by ``DEVICE`` and ``REST``.
        counts: of packets, by direction, as of the last change.
    """

    _numbers = itertools.count(1)

    def __init__(self, to_rest: Path | None = None, to_device: Path | None = None) -> None:
        stem = f"hm{os.getpid()}x{next(self._numbers)}"
        self.namespaces = {DEVICE: f"{stem}d", REST: f"{stem}r"}
        self._wire = f"{stem}w"
        self._forwarder: subprocess.Popen[str] | None = None
        self.counts: Mapping[str, Mapping[str, int]] = {}
        self._paths = {"to_rest": to_rest or Path(), "to_device": to_device or Path()}

    def __enter__(self) -> EmulatedNetwork:
        """Make the namespaces and start the forwarder.

        Raises:
            NoNetworkError: this machine does not let us.
        """
        if reason := not_permitted():
            raise NoNetworkError(reason)
        try:
            self._build()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def command(self, side: str, command: Sequence[str]) -> list[str]:
        """Return a command as it is run on one side."""
        return ["ip", "netns", "exec", self.namespaces[side], *command]

    def set(self, both: Path | None = None, **ways: Path) -> float:
        """Set ``to_rest``, ``to_device``, or both; return since when that is so, s of the clock."""
        self._paths.update(ways if both is None else {"to_rest": both, "to_device": both})
        forwarder = self._forwarder
        if forwarder is None or forwarder.stdin is None or forwarder.stdout is None:
            raise RuntimeError("the network is not there: use it as a context manager")
        json.dump({name: asdict(path) for name, path in self._paths.items()}, forwarder.stdin)
        print(file=forwarder.stdin, flush=True)
        said = json.loads(forwarder.stdout.readline())
        self.counts = said["counts"]
        return float(said["set_s"])

    def close(self) -> None:
        """End the forwarder, and take the namespaces away; what runs in them keeps them alive."""
        if self._forwarder is not None:
            try:
                # Ends its input first.
                self._forwarder.communicate(timeout=2.0)
            except subprocess.TimeoutExpired:
                self._forwarder.kill()
                self._forwarder.communicate()
            self._forwarder = None
        for name in (*self.namespaces.values(), self._wire):
            if FilePath("/run/netns", name).exists():
                _ip("netns", "del", name)

    def _build(self) -> None:
        _ip("netns", "add", self._wire)
        for index, (side, name) in enumerate(self.namespaces.items()):
            other = REST if side == DEVICE else DEVICE
            address, mac = ADDRESSES[side], _LINK_ADDRESSES[side]
            # A name of its own until it is where it belongs: this namespace may have an eth0.
            inner, outer = f"{name[2:-1]}{index}i", f"end{index}"
            _ip("netns", "add", name)
            _ip("link", "add", inner, "type", "veth", "peer", "name", outer, "netns", self._wire)
            _no_offload(inner)
            _ip("link", "set", inner, "netns", name, "name", "net0", "address", mac, "mtu", _MTU)
            _ip("-n", name, "address", "add", f"{address}/24", "dev", "net0")
            for link in ("lo", "net0"):
                _ip("-n", name, "link", "set", link, "up")
            _ip("-n", name, "route", "add", "224.0.0.0/4", "dev", "net0")
            there = (ADDRESSES[other], "lladdr", _LINK_ADDRESSES[other])
            _ip("-n", name, "neighbour", "add", *there, "dev", "net0")
            _ip("-n", self._wire, "link", "set", outer, "mtu", _MTU, "up")
        self._forwarder = subprocess.Popen(
            ["ip", "netns", "exec", self._wire, sys.executable, "-m", _FORWARDER, "end0", "end1"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        self.set()


def _ip(*arguments: object) -> None:
    command = ["ip", *map(str, arguments)]
    found = subprocess.run(command, check=False, capture_output=True, text=True)
    if found.returncode:
        raise RuntimeError(f"{' '.join(command)}: {found.stderr.strip()}")


def _no_offload(interface: str) -> None:
    """Switch off what an interface would leave to its hardware."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        for setting in _ETHTOOL_OFF:
            value = ctypes.create_string_buffer(struct.pack("II", setting, 0))
            request = struct.pack("16sP", interface.encode(), ctypes.addressof(value))
            # One that it has not is off.
            with suppress(OSError):
                fcntl.ioctl(any_socket, _SIOCETHTOOL, request)
