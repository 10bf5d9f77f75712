# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech live``: bad addresses, and what is missing, are one sentence each."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError

import pytest

from hapticmech_ros.cli.live import live
from hapticmech_ros.errors import InstallationError, InvalidInputError
from hapticmech_ros.live.settings import VISER
from hapticmech_ros.system import installation


@pytest.mark.parametrize("host", ["", "nowhere", "127.0.0.1:80", "256.0.0.1"])
def test_what_is_no_address_is_refused(host):
    with pytest.raises(InvalidInputError, match="--host: must be an address such as"):
        live("five_bar", 8080, host)


def test_without_viser_it_says_what_to_install(monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(installation, "distribution", missing)
    monkeypatch.setattr(installation, "find_spec", lambda name: None)
    with pytest.raises(InstallationError, match="viser is not installed") as raised:
        live("five_bar", 8080, "127.0.0.1")
    assert raised.value.needed == (VISER,)


def needed_by(extra):
    from importlib.metadata import requires

    found = [one for one in requires("hapticmech_ros") or () if f'extra == "{extra}"' in one]
    return {one.split(";")[0].strip() for one in found}


def test_the_extra_asks_for_what_the_command_asks_for():
    """And for what reads MJCF files, which it draws too."""
    assert needed_by("live") == {VISER} | needed_by("mjcf")
