# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Discovery of a graph: by processes on this machine only, unless requested otherwise.

Imports no ROS.

For ROS's ``LOCALHOST``, a profile of Fast DDS binds its sockets to the loopback interface. ROS's
own method leaves sockets on all interfaces and turns shared memory on again, where a process killed
while it holds a lock blocks its peers for seconds.
"""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Iterator, MutableMapping
from pathlib import Path
from typing import Literal

from hapticmech_ros.files import shared

Discovery = Literal["localhost", "subnet"]
# Between processes of one host: directly where both can, or always through the middleware.
Transport = Literal["auto", "middleware"]
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PEERS = "ROS_STATIC_PEERS"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
# Before Jazzy's range there was this.
_LOCALHOST_ONLY = "ROS_LOCALHOST_ONLY"
_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_LOOPBACK, _NETWORK = "config/dds/loopback_udp.xml", "config/dds/discovery.xml"
_LISTENS = "0A"


def choose_discovery(environment: MutableMapping[str, str], asked: Discovery | None = None) -> None:
    """Let processes with this environment be found from this machine alone, or from the network.

    The network is chosen by ``ROS_AUTOMATIC_DISCOVERY_RANGE`` (SUBNET or SYSTEM_DEFAULT), by
    ``ROS_STATIC_PEERS``, or by a profile of the user's own, which is left as it is.

    Args:
        environment: is changed; twice gives the same as once.
        asked: overrides the environment's range and peers.
    """
    if asked is not None:
        environment.pop(_LOCALHOST_ONLY, None)
        environment[RANGE] = asked.upper()
    if asked == "localhost":
        environment.pop(PEERS, None)
    environment.setdefault(_TRANSPORTS, "UDPv4")
    profile = environment.get(PROFILES, "")
    if profile and not _is_loopback(profile):
        return
    local = _is_local(environment)
    if not environment.get("RMW_IMPLEMENTATION", "rmw_fastrtps").startswith("rmw_fastrtps"):
        # Other middlewares obey the range by themselves.
        if local:
            environment[RANGE] = "LOCALHOST"
        return
    profiles = shared(_LOOPBACK if local else _NETWORK)
    if profiles is None:
        return
    if not (local and profile):
        # Processes with the same path meet on the lane too.
        environment[PROFILES] = str(profiles)
    if local and environment.get(RANGE, "").upper() == "LOCALHOST":
        del environment[RANGE]
    if local:
        environment.pop(_LOCALHOST_ONLY, None)


def exposure() -> str:
    """Return in one sentence that this process can be reached from the network; or nothing.

    Call it once the middleware has its sockets: it examines these, not the settings.
    """
    found = sorted({f"{kind} {address}" for kind, address in listening(os.getpid())})
    if not found:
        return ""
    ours = str(shared(_NETWORK))
    given = [name for name in (PEERS, PROFILES) if os.environ.get(name, ours) != ours]
    unset = f"unset {' '.join(given)}; " if given else ""
    return (
        f"open to the network ({', '.join(found)}): any host that reaches this machine can "
        "apply forces, set parameters and stop nodes; to restrict nodes to this machine: "
        f"{unset}export {RANGE}=LOCALHOST"
    )


def _is_loopback(profile: str) -> bool:
    """Return whether a profile is the one for this machine alone, of any installation."""
    own = shared(_LOOPBACK)
    try:
        return own is not None and Path(profile).read_bytes() == own.read_bytes()
    except OSError:
        return False


def _is_local(environment: MutableMapping[str, str]) -> bool:
    if environment.get(_LOCALHOST_ONLY) == "1":
        return True
    wide = environment.get(RANGE, "").upper() in ("SUBNET", "SYSTEM_DEFAULT")
    return not (wide or environment.get(PEERS))


def listening(process: int) -> Iterator[tuple[str, str]]:
    """Yield kind and address of a process's sockets that other machines can reach.

    Raises:
        OSError: there is no such process, or it is another user's.
    """
    own = set(_sockets(process))
    for kind in ("udp", "udp6", "tcp", "tcp6"):
        try:
            lines = Path(f"/proc/{process}/net/{kind}").read_text().splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            if fields[9] not in own or (kind.startswith("tcp") and fields[3] != _LISTENS):
                continue
            address = _address(fields[1].split(":")[0])
            if not (address.is_loopback or address.is_multicast):
                yield kind.rstrip("6").upper(), str(address)


def _sockets(process: int) -> Iterator[str]:
    for file in Path(f"/proc/{process}/fd").iterdir():
        try:
            name = str(file.readlink())
        except OSError:
            # Closed meanwhile.
            continue
        if name.startswith("socket:["):
            yield name[8:-1]


def _address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    """Return an address from words of 32 bits as the kernel writes them: in the machine's order."""
    words = [bytes.fromhex(text[at : at + 8])[::-1] for at in range(0, len(text), 8)]
    found = ipaddress.ip_address(b"".join(words))
    mapped = getattr(found, "ipv4_mapped", None)
    return found if mapped is None else mapped
