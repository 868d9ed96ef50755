"""What a user reads of a `.dgs` file that is refused: its name, what is wrong, and what to do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from dfcgs_codec.bitstream.container import ContainerReader
from dfcgs_codec.codec.frame.chunk_search import ChunkSearch
from dfcgs_codec.codec.frame.headers import beyond_default_limits
from dfcgs_codec.errors import (
    BitstreamError,
    CorruptBitstream,
    ResourceLimit,
    TruncatedBitstream,
    VerificationError,
)

_DAMAGE = (TruncatedBitstream, CorruptBitstream, VerificationError)


class StreamFile(click.Path):
    """A `.dgs` file that exists."""

    def __init__(self) -> None:
        super().__init__(path_type=Path, exists=True, dir_okay=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path; a folder is told from a file."""
        if Path(value).is_dir():
            self.fail(
                f"{value} is a folder, and one .dgs file was expected; "
                f"to make one of a folder of PLY frames: dfcgs encode {value} out.dgs",
                param,
                ctx,
            )
        return super().convert(value, param, ctx)


def _has_frames(file: Path) -> bool:
    """Whether the sequence header is whole, without which nothing is, and an I-frame."""
    try:
        with file.open("rb") as stream:
            return next(ChunkSearch(ContainerReader(stream)).gofs(), None) is not None
    except (BitstreamError, OSError):
        return False


def allowing_option(error: ResourceLimit) -> str:
    """The option that would have let the file pass."""
    if error.field == "max_memory":
        return f"--max-memory {-(-error.value * 11 // (10 << 20))}M"
    return f"--max-gaussians {error.value}"


def note_of_limits(file: Path) -> None:
    """Say on stderr what a file that was made needs to be decoded, where that is more than the default."""
    refusal = beyond_default_limits(file) if file.is_file() else None
    if refusal is not None:
        option = allowing_option(refusal)
        click.echo(f"note: decode {file} with {option}, or it is refused: {refusal.what}", err=True)


@contextmanager
def refused_by_name(file: Path, *, salvage: bool = True) -> Iterator[None]:
    """Errors in the block are those of `file`; `salvage`: whether that can still be tried."""
    try:
        yield
    except ResourceLimit as error:
        advice = f"if you trust it, {allowing_option(error)} allows it"
        raise ResourceLimit(f"{file}: {error.what}", error.field, error.value, advice) from error
    except (BitstreamError, VerificationError) as error:
        advice = ""
        if salvage and isinstance(error, _DAMAGE):
            advice = "; no frame is whole, so that --salvage would find none"
            if _has_frames(file):
                advice = f"; dfcgs decode {file} OUTPUT_DIR --salvage takes the frames that are whole"
        raise type(error)(f"{file}: {error}{advice}") from error
