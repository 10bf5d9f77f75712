# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How long a newcomer waits, from the clone to the page of an own mechanism with a loop.

``python3 benchmarks/live/first_minutes.py``, which needs no package: in a new folder and with an
empty home, so that nothing is there that an earlier installation left. What a browser does after
that is not counted.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.request import urlopen

ROOT = Path(__file__).parents[2]
GOAL_S = 300.0


def main() -> int:
    """Print what each command took, s; return 0 if all took less than the goal."""
    with TemporaryDirectory() as folder:
        home, clone = Path(folder, "home"), Path(folder, "clone")
        home.mkdir()
        kept = ("PATH", "LANG", "TERM", "SSL_CERT_FILE", "PIP_INDEX_URL", "PIP_CERT")
        environment = {key: os.environ[key] for key in kept if key in os.environ}
        environment |= {"HOME": str(home), "PIP_NO_CACHE_DIR": "1"}

        begun = time.monotonic()
        subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
        took = {"git clone": time.monotonic() - begun}
        for name in ("urdf", "yaml"):
            own = shutil.copy(clone / "examples" / f"pantograph.{name}", home / f"mine.{name}")
            text = Path(own).read_text(encoding="utf-8")
            Path(own).write_text(text.replace("pantograph.urdf", "mine.urdf"), encoding="utf-8")
        for command in (
            ["make", "live"],
            [".venv/bin/hapticmech", "live", str(home / "mine.yaml")],
        ):
            took[" ".join(command[:2])] = until_served(command, clone, environment)
    for name, seconds in took.items():
        print(f"{name:<28}{seconds:7.1f} s")
    print(f"{'all':<28}{sum(took.values()):7.1f} s (goal {GOAL_S:g})")
    return int(sum(took.values()) > GOAL_S)


def until_served(command: list[str], clone: Path, environment: dict[str, str]) -> float:
    """Return after how long, s, a command serves the page that it names; then end it."""
    begun = time.monotonic()
    process = subprocess.Popen(
        command,
        cwd=clone,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        for line in process.stdout or ():
            if found := re.search(r"http://[0-9.:]+", line):
                with urlopen(found[0]) as page:
                    page.read()
                return time.monotonic() - begun
        raise SystemExit(f"{' '.join(command)} ended without a page")
    finally:
        os.killpg(process.pid, signal.SIGINT)
        process.wait()


if __name__ == "__main__":
    sys.exit(main())
