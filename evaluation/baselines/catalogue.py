"""All methods of the comparison by name."""

from __future__ import annotations

from evaluation.baselines import delta_zstd_file, fourdgs, hevc, raw_zstd, sog, splats4d, spz_frames, spz_gof
from evaluation.baselines.method import Method

_ALL: tuple[Method, ...] = (
    raw_zstd.METHOD,
    delta_zstd_file.METHOD,
    spz_frames.METHOD,
    spz_gof.METHOD,
    fourdgs.METHOD,
    splats4d.METHOD,
    hevc.METHOD,
    sog.METHOD,
)

METHODS: dict[str, Method] = {method.name: method for method in _ALL}
