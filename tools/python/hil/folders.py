"""Folders of sessions in two processes.

Each is locked as long as its Python or a process of the run lives. A Python that is killed leaves its folder, which a
later session removes.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from pathlib import Path
from typing import Tuple

PREFIX = "hil-session-"
LOCK = "lock"


def create() -> Tuple[str, int]:
    """Removes the folders that nobody uses; returns a new one, and the file that locks it until `remove`."""
    for lock in Path(tempfile.gettempdir()).glob(f"{PREFIX}*/{LOCK}"):
        _remove_unused(lock)
    folder = tempfile.mkdtemp(prefix=PREFIX)
    early = os.path.join(folder, "early")
    file = os.open(early, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    fcntl.flock(file, fcntl.LOCK_EX)
    # Named when it is locked, because another process may look at any time.
    os.rename(early, os.path.join(folder, LOCK))
    return folder, file


def remove(folder: str, file: int) -> None:
    """Removes a folder, whose lock ends."""
    shutil.rmtree(folder, ignore_errors=True)
    os.close(file)


def _remove_unused(lock: Path) -> None:
    try:
        file = os.open(lock, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:
        return  # of another user, or removed meanwhile
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(lock.parent, ignore_errors=True)
    except OSError:
        pass  # in use
    finally:
        os.close(file)
