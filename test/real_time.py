"""What the machine that runs the tests grants."""

import subprocess
import sys


def grants_real_time(priority: int) -> bool:
    """Return whether this user may have a real-time priority: asked by a process of its own."""
    code = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({priority}))"
    asked = subprocess.run([sys.executable, "-c", code], check=False, stderr=subprocess.DEVNULL)
    return asked.returncode == 0
