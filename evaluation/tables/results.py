"""The tables of `docs/results.md`.

Each stands between `<!-- NAME -->` and `<!-- end of NAME -->`; the text around them is written by hand.
"""

from __future__ import annotations

from collections.abc import Callable

from evaluation.tables import captures, comparison, intra, motion, paper, prior, robustness
from evaluation.tables.markdown import replace_between
from lab.record import REPOSITORY, has_results

PAGE = REPOSITORY / "docs" / "results.md"
#: mark: the result that a table is made of, and who makes it
TABLES: dict[str, tuple[str, Callable[[], str]]] = {
    "averages": ("bench", comparison.averages),
    "motion": ("bench", motion.motion_table),
    "ablation": ("motion", motion.ablation_table),
    "compensation": ("compensation", motion.compensation_table),
    "long smooth": ("long_smooth", motion.long_smooth_table),
    "bd": ("bench", comparison.bd_table),
    "refusals": ("bench", comparison.refusal_table),
    "presets": ("bench", comparison.preset_table),
    "speed": ("bench", comparison.speed_table),
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
}


def filled(text: str) -> str:
    """The page with all tables that there are results for; ValueError where one has no place."""
    for name, (source, made) in TABLES.items():
        if has_results(source):
            text = replace_between(text, name, made())
    return text
