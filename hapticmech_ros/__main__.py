# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``hapticmech``, also as ``python -m hapticmech_ros``."""

import sys

from hapticmech_ros.errors import InstallationError
from hapticmech_ros.system.installation import refuse_unmet


def main() -> None:
    """Run the command, if its requirements are installed."""
    try:
        refuse_unmet()
    except InstallationError as error:
        sys.exit(f"error: {error}")
    from hapticmech_ros.cli import main as command

    command()


if __name__ == "__main__":
    main()
