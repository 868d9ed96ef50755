"""Frames as they were announced when the sequence was planned: the file's header rests on that."""

from __future__ import annotations

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import FrameSource


def check_announced(source: FrameSource, index: int, cloud: GaussianCloud, sh_degree: int) -> None:
    """InputError where frame `index`, as it was read, is another than `source` has said of it."""
    found, planned = (cloud.num_gaussians, cloud.sh_degree), (source.headers[index].num_gaussians, sh_degree)
    if found != planned:
        raise InputError(
            f"frame {source.numbers[index]}: {found[0]} Gaussians of SH degree {found[1]}, but "
            f"{planned[0]} of SH degree {planned[1]} were announced; frames must not change meanwhile"
        )
