"""What Numba compiled in an earlier process: one file for each function, with its hash in front.

Numba's own cache runs whatever its files hold: half of one ends the process, and one with a hole
in its machine code does so later.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
from pathlib import Path
from typing import Any

from hapticmech_ros.compilation.sealed import BrokenSealError, open_own

_DIGEST_BYTES = hashlib.sha256().digest_size


def keep(dispatcher: Any) -> None:
    """Let a function that Numba is to compile be kept where Numba would keep it.

    Raises:
        OSError, RuntimeError: there is no folder for it.
    """
    dispatcher.enable_caching()
    cache = dispatcher._cache
    theirs = cache._cache_file
    about = f"{theirs._source_stamp}{theirs._version}"
    cache._cache_file = _KeptFiles(Path(theirs._cache_path), cache._impl.filename_base, about)


class _KeptFiles:
    """Stands in for ``numba.core.caching.IndexDataCacheFile``.

    Args:
        folder: where the files are.
        name: of the function.
        about: whatever else they depend on.
    """

    def __init__(self, folder: Path, name: str, about: str) -> None:
        self._folder, self._name, self._about = folder, name, about

    def load(self, key: object) -> object:
        """Return what was compiled, or None if that is not there as it was written."""
        try:
            with os.fdopen(open_own(self._path(key)), "rb") as file:
                content = file.read()
        except (OSError, BrokenSealError):
            return None
        digest, data = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
        # As this user wrote it: only then may it be unpickled.
        return pickle.loads(data) if hashlib.sha256(data).digest() == digest else None

    def save(self, key: object, compiled: object) -> None:
        """Write what was compiled; a disk that is full means that it is compiled again."""
        from numba.core import serialize

        # Of Numba, which has no types.
        dumps: Any = serialize.dumps
        data: bytes = dumps(compiled)
        path = self._path(key)
        written = path.with_name(f"{path.name}.{os.urandom(8).hex()}")
        try:
            written.write_bytes(hashlib.sha256(data).digest() + data)
            written.chmod(0o644)
            written.replace(path)
        except OSError:
            with contextlib.suppress(OSError):
                written.unlink(missing_ok=True)

    def _path(self, key: object) -> Path:
        of = hashlib.sha256(f"{key}{self._about}".encode()).hexdigest()[:16]
        return self._folder / f"{self._name}-{of}.kernel"
