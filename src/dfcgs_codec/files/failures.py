"""System errors that name the file they are about."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: what only writing meets; the system gives these errors no name
_WRITING = {errno.ENOSPC, errno.EFBIG, errno.EROFS, getattr(errno, "EDQUOT", errno.ENOSPC)}


@contextmanager
def named(path: Path, *, writing_only: bool = False) -> Iterator[None]:
    """An OSError without a file name, raised inside, is about `path`.

    `writing_only`: so are only those that mean a full disk, a quota or a limit of size; others may come from
    files that are read meanwhile.
    """
    try:
        yield
    except OSError as error:
        if error.filename is not None or (writing_only and error.errno not in _WRITING):
            raise
        # array libraries say only how much was written
        reason = (
            error.strerror or f"not written whole ({error}): the disk, a quota or a file size limit is full"
        )
        raise OSError(error.errno or errno.EIO, reason, str(path)) from error
