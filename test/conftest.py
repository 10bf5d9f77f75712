"""What all tests share: developers' tools in benchmarks/, which are not installed, are found."""

import sys
from pathlib import Path

# Last, so that the package is still the installed one.
sys.path.append(str(Path(__file__).resolve().parents[1]))
