"""Real spherical harmonics up to degree 3, with the signs and order of 3DGS (Kerbl et al. 2023).

`direction` is a unit 3-tuple from the camera to the Gaussian; `count` is 1, 4, 9 or 16 basis functions.
"""

from __future__ import annotations

from lab.render.kernel import kernel

C0 = 0.28209479177387814
C1 = 0.4886025119029199
C2 = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
C3 = (0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154, 1.445305721320277)


@kernel
def sh_basis(count, direction, basis):
    """Write the values of the first `count` basis functions into `basis` (16,)."""
    x, y, z = direction
    basis[0] = C0
    if count > 1:
        basis[1] = -C1 * y
        basis[2] = C1 * z
        basis[3] = -C1 * x
    if count > 4:
        basis[4] = C2[0] * x * y
        basis[5] = -C2[0] * y * z
        basis[6] = C2[1] * (2 * z * z - x * x - y * y)
        basis[7] = -C2[0] * x * z
        basis[8] = C2[2] * (x * x - y * y)
    if count > 9:
        basis[9] = -C3[0] * y * (3 * x * x - y * y)
        basis[10] = C3[1] * x * y * z
        basis[11] = -C3[2] * y * (4 * z * z - x * x - y * y)
        basis[12] = C3[3] * z * (2 * z * z - 3 * x * x - 3 * y * y)
        basis[13] = -C3[2] * x * (4 * z * z - x * x - y * y)
        basis[14] = C3[4] * z * (x * x - y * y)
        basis[15] = -C3[0] * x * (x * x - 3 * y * y)


@kernel
def sh_direction_gradient(direction, weights):
    """Gradient of sum_k weights[k] * basis[k] by the direction, as a 3-tuple.

    weights: one per basis function; its length is 1, 4, 9 or 16.
    """
    x, y, z = direction
    w = weights
    gx = gy = gz = 0.0
    if len(w) > 1:
        gx -= C1 * w[3]
        gy -= C1 * w[1]
        gz += C1 * w[2]
    if len(w) > 4:
        gx += C2[0] * (w[4] * y - w[7] * z) + 2 * x * (C2[2] * w[8] - C2[1] * w[6])
        gy += C2[0] * (w[4] * x - w[5] * z) - 2 * y * (C2[2] * w[8] + C2[1] * w[6])
        gz += 4 * C2[1] * w[6] * z - C2[0] * (w[5] * y + w[7] * x)
    if len(w) > 9:
        p = x * x - y * y
        gx += C3[1] * w[10] * y * z + 2 * C3[2] * w[11] * x * y - 6 * C3[3] * w[12] * x * z
        gx += 2 * C3[4] * w[14] * x * z - 6 * C3[0] * w[9] * x * y - 3 * C3[0] * w[15] * p
        gx -= C3[2] * w[13] * (4 * z * z - 3 * x * x - y * y)
        gy += C3[1] * w[10] * x * z + 2 * C3[2] * w[13] * x * y - 6 * C3[3] * w[12] * y * z
        gy += 6 * C3[0] * w[15] * x * y - 2 * C3[4] * w[14] * y * z - 3 * C3[0] * w[9] * p
        gy -= C3[2] * w[11] * (4 * z * z - x * x - 3 * y * y)
        gz += C3[1] * w[10] * x * y + C3[4] * w[14] * p - 8 * C3[2] * z * (w[11] * y + w[13] * x)
        gz += C3[3] * w[12] * (6 * z * z - 3 * x * x - 3 * y * y)
    return gx, gy, gz
