"""How far the paper's compensation could go with the best motions that any network could give it.

The control points' motions are fitted to where the Gaussians of each frame really go (least squares over all
of them), from the decoded I-frame each time, without drift, and not quantised beyond the grid; what that
would cost is left open.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array, identity
from scipy.sparse.linalg import splu

from dfcgs_codec import EncoderOptions, EncoderTuning, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.bitstream.constants import Attribute, IntraKind, OutputOrder
from dfcgs_codec.codec.compensation import GofMotion, spread_over
from dfcgs_codec.codec.dpb import FrameState, output
from dfcgs_codec.encoder.plan import SequencePlan
from dfcgs_codec.encoder.planning import plan_sequence
from dfcgs_codec.encoder.spread_motion import spread_header
from dfcgs_codec.encoder.targets import Planes, Targets
from dfcgs_codec.sequence import MemorySource
from dfcgs_codec.transform.spreading import SPREAD_WEIGHT_BITS, Spreading

Float64 = npt.NDArray[np.float64]
#: keeps motions of control points apart that share all their Gaussians
_DAMPING = 1e-6


def _shares(spreading: Spreading, count: int) -> csr_array:
    """(N, n): what of a control point's motion a Gaussian gets."""
    points, neighbours = spreading.gaussians.shape
    columns = np.repeat(np.arange(points), neighbours)
    weights = spreading.weights.ravel() * 2.0**-SPREAD_WEIGHT_BITS
    return csr_array((weights, (spreading.gaussians.ravel(), columns)), shape=(count, points))


def _went(target: Planes, reference: FrameState) -> Float64:
    """Changes of positions and quaternions (N, 7)."""
    old = [reference.planes[a].wide() for a in (Attribute.POSITION, Attribute.ROTATION)]
    turned = target[Attribute.ROTATION]
    turned = np.where((turned * old[1]).sum(axis=1, keepdims=True) < 0, -turned, turned)
    changes = [target[Attribute.POSITION] - old[0], turned - old[1]]
    return np.concatenate(changes, axis=1).astype(np.float64)


def _intra(frames: list[GaussianCloud], qp: float) -> tuple[SequencePlan, FrameState]:
    """The decoded I-frame, its Gaussians' places in the output being those of the input."""
    source = MemorySource(frames[:1])
    tuning = EncoderTuning(intra=IntraKind.PLY)
    plan = plan_sequence(source, EncoderOptions(qp=qp, order=OutputOrder.INPUT, tuning=tuning))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "intra.dgs"
        encode_sequence(source, path, plan.options)
        return plan, next(iter(decode_sequence(path))).state


def best_spread(frames: list[GaussianCloud], qp: float) -> Iterator[GaussianCloud]:
    """Prediction of every frame but the first, all of which are tracked."""
    plan, reference = _intra(frames, qp)
    count = reference.num_gaussians
    motion = GofMotion.of(reference.planes[Attribute.POSITION].wide(), plan.gof_setup.control)
    spread = spread_header(plan, motion.field.num_points).spread
    assert spread is not None
    spreading = motion.spreading.of(spread.num_neighbours, spread.decay_exponent, motion.origins)
    shares = _shares(spreading, count)
    normal = (shares.T @ shares + _DAMPING * identity(shares.shape[1])).tocsc()
    solver = splu(normal)
    order = np.arange(count) if reference.order is None else reference.order.values[:, 0]
    targets = Targets(plan.header.unit_exponents)
    for cloud in frames[1:]:
        target = {attribute: plane[order] for attribute, plane in targets.planes(cloud).items()}
        best = np.rint(solver.solve(shares.T @ _went(target, reference))).astype(np.int64)
        state = spread_over(best, spreading, np.ones(count, np.bool_), reference)
        yield output(state, plan.header.unit_exponents)
