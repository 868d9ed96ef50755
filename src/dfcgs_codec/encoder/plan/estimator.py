"""The error of I-frames at different QPs, estimated in patches of some frames, and the QP of a quality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.encoder.frame.off_grid import Grids
from dfcgs_codec.encoder.frame.targets import Targets
from dfcgs_codec.encoder.images.patches import NEARBY_BIAS, PATCHES, Patch, patches_nearby
from dfcgs_codec.encoder.images.shown import Region
from dfcgs_codec.encoder.images.splats import Splats
from dfcgs_codec.encoder.plan.allocation import Balance, Look, balanced_plan, intra_errors
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.quantiser_steps import MAX_QP, MIN_QP, QUALITIES, expected_qp
from dfcgs_codec.encoder.plan.subject import Subject
from dfcgs_codec.gaussians import GaussianCloud

#: a QP is near enough when the estimate is so near the quality asked for, dB
_NEAR_ENOUGH = 0.4
#: a quality is a promise, and estimates are uncertain, the more so the finer: so many dB more are aimed at
#: up to 37 dB, and so many more with each dB beyond
_MARGIN, _MORE_MARGIN = 1.0, 0.15
#: QPs that are tried
_MOST_TRIALS = 4


@dataclass(frozen=True)
class _Trial:
    """A plan that is not balanced yet, and what was `found` of its errors when it was looked at."""

    plan: SequencePlan
    looks: list[Look]
    found: Balance


@dataclass(frozen=True)
class _View:
    """A frame as it is looked at: the Gaussians that are coded and lie near others, and patches of them."""

    cloud: GaussianCloud
    cover: Int64 | None
    patches: list[Patch]


class Estimator:
    """Estimates the error of I-frames at different QPs, in one choice of patches of some frames."""

    def __init__(self, subject: Subject, region: Region | None) -> None:
        self._subject, self._region = subject, region
        self._left_out = 0.0 if region is None or region.keeps_unseen else region.error
        units = subject.plan(expected_qp(subject.options.qp, subject.options.quality)).header.unit_exponents
        indices = subject.looked_at()
        views = [self._view(index, Grids(units), (part, len(indices))) for part, index in enumerate(indices)]
        self._views = [view for view in views if view.patches]

    def _view(self, index: int, grids: Grids, part: tuple[int, int]) -> _View:
        seen = self._subject.seen
        cloud = seen.of(self._subject.frame(index))
        _, escapes = grids.split(cloud)
        near = np.arange(cloud.num_gaussians)
        # who lies apart from all others has no say in how these are coded
        near = near if escapes is None else np.setdiff1d(near, escapes.rows)
        cloud, patches = cloud.take(near), []
        cover = None if seen.cover is None else seen.cover[near]
        if len(near):
            splats = Splats.of(cloud)
            with np.errstate(all="ignore"):
                if self._region is None:
                    patches = patches_nearby(splats, -(-PATCHES // part[1]), part[0])
                else:
                    patches = self._region.patches(splats, *part)
        return _View(cloud, cover, patches)

    def tried(self, qp: float) -> _Trial:
        """Planned with that QP, and what it leads to."""
        plan = self._subject.plan(qp)
        units, looks = plan.header.unit_exponents, []
        for view in self._views:
            on_grid, _ = Grids(units).split(view.cloud)
            looks.append(Look(Targets(units.from_origin).planes(on_grid), view.cover, view.patches))
        if not looks:
            return _Trial(plan, [], Balance({}, 0.0))
        found = intra_errors(plan, looks)
        error = found.error + self._left_out
        if error > 0.0:
            bias = NEARBY_BIAS if self._region is None else 0.0
            plan = replace(plan, estimate=bias - 10.0 * float(np.log10(error)))
        if self._left_out > 0.0 and found.error > 0.0:
            plan = replace(plan, unseen_cost=10.0 * float(np.log10(error / found.error)))
        return _Trial(plan, looks, found)

    def planned(self) -> SequencePlan:
        """With the QP asked for, or the one that gives the quality asked for."""
        options = self._subject.options
        trial = self.tried(expected_qp(options.qp, options.quality))
        if options.qp is None:
            trial = self._searched(trial, aimed_at(options.quality))
        if not (trial.looks and options.tuning.balance):
            return trial.plan
        return balanced_plan(trial.plan, trial.looks, trial.found)

    def _searched(self, trial: _Trial, psnr: float) -> _Trial:
        tried: list[tuple[float, _Trial]] = []
        while trial.plan.estimate is not None:
            tried.append((trial.plan.estimate - psnr, trial))
            error, nearest = min(tried, key=lambda pair: abs(pair[0]))
            better = _better_qp([(more, before.plan.qp) for more, before in tried])
            if abs(error) < _NEAR_ENOUGH or len(tried) == _MOST_TRIALS or better == trial.plan.qp:
                return nearest
            trial = self.tried(better)
        return trial


def aimed_at(quality: float) -> float:
    """The estimate, dB, at which images are about as good as `quality`, or better."""
    return quality + _MARGIN + _MORE_MARGIN * max(quality - QUALITIES["medium"], 0.0)


def _better_qp(tried: Sequence[tuple[float, float]]) -> float:
    """The QP to try next; `tried`: by how many dB estimates are better than what is asked for, and QPs."""
    finer = min((trial for trial in tried if trial[0] >= 0.0), default=None)
    coarser = max((trial for trial in tried if trial[0] < 0.0), default=None)
    if finer is not None and coarser is not None:
        # a few Gaussians that swap places make steps in the curve: between the two it has to be
        return float(np.interp(0.0, [coarser[0], finer[0]], [coarser[1], finer[1]]))
    more, qp = min(tried, key=lambda trial: abs(trial[0]))
    return float(np.clip(qp + more, MIN_QP, MAX_QP))
