"""The constants of the image formation, as in gsplat 1.5 (classic mode)."""

from __future__ import annotations

#: pixels; width and height of a tile
TILE = 16
#: the largest alpha of one Gaussian at one pixel
ALPHA_CAP = 0.999
#: a Gaussian whose alpha is below this leaves the pixel alone
ALPHA_CUT = 1.0 / 255.0
#: the Gaussian that would take a pixel's transmittance to this or below is left out, and all behind it
TRANSMITTANCE_STOP = 1e-4
#: square pixels; added to both variances in the image
LOW_PASS = 0.3
#: scene units; Gaussians with a centre nearer than this, or behind the camera, are not drawn
NEAR = 0.01
#: the perspective Jacobian is taken no farther outside the image than this share of its width and height
JACOBIAN_MARGIN = 0.15
