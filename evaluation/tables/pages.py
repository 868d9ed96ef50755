"""Which table stands where: between `<!-- NAME -->` and `<!-- end of NAME -->` on any page.

Pages are README.md and everything in `docs/`. The text around tables is written by hand. A table may stand on
more than one page.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from evaluation.tables import (
    captures,
    comparison,
    field,
    intra,
    motion,
    paper,
    prior,
    robustness,
    single,
    summary,
)
from evaluation.tables.markdown import replace_between
from lab.record import REPOSITORY, has_results

#: mark: the result that a table is made of (None: it says itself what is missing), and who makes it
TABLES: dict[str, tuple[str | None, Callable[[], str]]] = {
    "summary": ("bench", summary.summary_table),
    "averages": ("bench", comparison.averages),
    "motion": ("bench", motion.motion_table),
    "ablation": ("motion", motion.ablation_table),
    "compensation": ("compensation", motion.compensation_table),
    "long smooth": ("long_smooth", motion.long_smooth_table),
    "bd": ("bench", comparison.bd_table),
    "refusals": ("bench", comparison.refusal_table),
    "presets": ("bench", comparison.preset_table),
    "speed": ("bench", comparison.speed_table),
    "frame times": ("speed", single.frame_times_table),
    "memory": ("memory", single.memory),
    "against zstd": ("against_zstd", single.zstd_table),
    "against spz": ("against_spz", single.spz_table),
    "drift": ("drift", robustness.drift_table),
    "stress": ("stress", robustness.stress_table),
    "allocation": ("allocation", intra.allocation_table),
    "identity": ("identity", robustness.identity_table),
    "lost order": ("identity", robustness.lost_order_table),
    "intra": ("intra", intra.ratio_table),
    "intra lossless": ("intra", intra.lossless_table),
    "quantised input": ("quantised_input", intra.quantised_table),
    "captures": ("captures", captures.bytes_table),
    "captures truth": ("captures", captures.truth_table),
    "promise": ("promise", captures.promise_table),
    "surroundings": ("surroundings", intra.surroundings_table),
    "prior": ("prior", prior.streams_table),
    "prior models": ("prior", prior.models_table),
    "paper curves": ("paper_profile", paper.curves_table),
    "paper whole": ("paper_profile", paper.whole_table),
    "paper ablations": ("paper_ablations", paper.ablation_table),
    "n3v": (None, field.n3v_table),
    "meetroom": (None, field.meetroom_table),
    "captures, the paper's measure": (None, field.captures_table),
    "other datasets": (None, field.robustness_table),
    "hyperparameters": ("paper_ablations", field.hyperparameters_table),
    "paper seconds": ("speed", field.time_table),
}
_MARK = re.compile(r"^<!-- (?!end of )(.*?) -->$", re.MULTILINE)


def pages() -> list[Path]:
    """README.md and all pages of `docs/`."""
    return [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]


def marks(text: str) -> list[str]:
    """Names of the tables that stand in `text`."""
    return [name for name in _MARK.findall(text) if name in TABLES]


def filled(text: str) -> str:
    """The page with all tables that there are results for; ValueError where a table has no end."""
    for name in marks(text):
        source, made = TABLES[name]
        if source is None or has_results(source):
            text = replace_between(text, name, made())
    return text
