"""``python -m hapticmech_ros``: the ``hapticmech`` command."""

from hapticmech_ros.cli import main

main()
