"""The motion of one frame: a smooth field of twists on nodes, plus a displacement and a turn per Gaussian.

With w the share of node j in Gaussian n, F the mean over a Gaussian's neighbours, c the nodes' places:

    displacement_n = sum_j w_nj (node_shift_j + node_turn_j x (p_n - c_j)) + (F shift)_n
    turn_n         = sum_j w_nj node_turn_j                                + (F turn)_n

The nodes find a limb's swing, which no Gaussian would find by itself from pixels that all look alike; the
averages F are what keeps neighbours together. Both are linear, so gradients go back through the transposes.
A turn is a rotation vector, applied after the Gaussian's own rotation.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from dfcgs_codec.array_types import Float32, Float64
from lab.scenes import rotations

GAUSSIANS_PER_NODE = 60
NODES_PER_GAUSSIAN = 4
NEIGHBOURS = 8


class Deformation:
    """The parameters, all zero at first, and their way to motion and back; n Gaussians, m nodes."""

    def __init__(self, positions: Float32, rng: np.random.Generator) -> None:
        n = len(positions)
        nodes = rng.choice(n, max(1, n // GAUSSIANS_PER_NODE), replace=False)
        # float64 and from the middle: the cross products below cancel
        self.positions = positions - positions.mean(axis=0, dtype=np.float64)
        self.nodes = self.positions[nodes]
        self.shares = _averages(self.positions, self.nodes, NODES_PER_GAUSSIAN)
        self.means = _averages(self.positions, self.positions, NEIGHBOURS)
        # transposed once: csr products are fast along rows only
        self.shares_back, self.means_back = self.shares.T.tocsr(), self.means.T.tocsr()
        self.values = {
            "node_shift": np.zeros((len(nodes), 3), np.float32),
            "node_turn": np.zeros((len(nodes), 3), np.float32),
            "shift": np.zeros((n, 3), np.float32),
            "turn": np.zeros((n, 3), np.float32),
        }

    def motion(self) -> tuple[Float64, Float64]:
        """Displacements and turns, (n, 3) each."""
        v = self.values
        offset = self.shares @ (v["node_shift"] - np.cross(v["node_turn"], self.nodes))
        turn = self.shares @ v["node_turn"]
        displacement = offset + np.cross(turn, self.positions) + self.means @ v["shift"]
        return displacement, turn + self.means @ v["turn"]

    def gradients(self, by_displacement: Float32, by_turn: Float32) -> dict[str, Float32]:
        """From the gradient by `motion`'s results, (n, 3) each, to that by the parameters."""
        node_shift = self.shares_back @ by_displacement
        node_turn = self.shares_back @ (np.cross(self.positions, by_displacement) + by_turn)
        found = {
            "node_shift": node_shift,
            "node_turn": node_turn - np.cross(self.nodes, node_shift),
            "shift": self.means_back @ by_displacement,
            "turn": self.means_back @ by_turn,
        }
        return {name: gradient.astype(np.float32) for name, gradient in found.items()}


def _averages(points: Float64, sources: Float64, count: int) -> csr_array:
    """(n, s) weights with rows that sum to one, from the nearest `count` of `sources` to each of `points`."""
    count = min(count, len(sources))
    distances, nearest = cKDTree(sources).query(points, np.arange(1, count + 1))
    width = np.maximum(distances.mean(axis=1, keepdims=True), 1e-6)
    weights = np.exp(-0.5 * (distances / width) ** 2)
    weights /= weights.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(points)), count)
    return csr_array((weights.reshape(-1), (rows, nearest.reshape(-1))), shape=(len(points), len(sources)))


def turned(quaternions: Float32, turns: Float64) -> Float32:
    """Quaternions (n, 4) of any length, turned by rotation vectors (n, 3)."""
    return rotations.multiply(rotations.from_vectors(turns), quaternions).astype(np.float32)


def turn_gradient(quaternions: Float32, gradient: Float32) -> Float32:
    """(n, 3) gradient by a further small turn, from that by the quaternions, (n, 4)."""
    # d(exp(t) q) / dt_i at t = 0 is half of the product of the i-th imaginary unit with q
    columns = [
        0.5 * np.einsum("ni,ni->n", gradient, rotations.multiply(unit, quaternions)) for unit in np.eye(4)[1:]
    ]
    return np.stack(columns, axis=1).astype(np.float32)
