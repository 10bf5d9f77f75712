"""Two machines that are none: network namespaces joined by a cable. Needs root and ``ip``."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
from collections.abc import Sequence
from types import TracebackType

from hapticmech_ros.errors import HapticMechError

_numbers = itertools.count()


class NoNamespacesError(HapticMechError):
    """This machine lets nobody make network namespaces."""


class TwoHosts:
    """Two network namespaces with a cable between them, 10.88.0.1 and 10.88.0.2.

    Use as a context manager: leaving it removes both. End the processes in them before.

    Attributes:
        names: of the namespaces.
        addresses: of the hosts.
    """

    addresses = ("10.88.0.1", "10.88.0.2")

    def __init__(self) -> None:
        stem = f"hx{os.getpid()}n{next(_numbers)}"
        self.names = (f"{stem}a", f"{stem}b")

    def on(self, host: int, command: Sequence[str]) -> list[str]:
        """Return a command that runs on a host; its process is the command's own."""
        return ["ip", "netns", "exec", self.names[host], *command]

    def __enter__(self) -> TwoHosts:
        if os.geteuid() or shutil.which("ip") is None:
            raise NoNamespacesError("network namespaces need root and the command `ip`")
        first, second = self.names
        try:
            for name in self.names:
                _ip("netns", "add", name)
            _ip(
                "link",
                "add",
                first,
                "netns",
                first,
                "type",
                "veth",
                "peer",
                second,
                "netns",
                second,
            )
            for name, address in zip(self.names, self.addresses, strict=True):
                _ip("-n", name, "address", "add", f"{address}/24", "dev", name)
                _ip("-n", name, "link", "set", name, "up")
                _ip("-n", name, "link", "set", "lo", "up")
                _ip("-n", name, "route", "add", "224.0.0.0/4", "dev", name)
        except HapticMechError:
            self._remove()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._remove()

    def _remove(self) -> None:
        for name in self.names:
            subprocess.run(["ip", "netns", "delete", name], check=False, capture_output=True)


def _ip(*arguments: str) -> None:
    done = subprocess.run(["ip", *arguments], check=False, capture_output=True, text=True)
    if done.returncode:
        raise NoNamespacesError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")
