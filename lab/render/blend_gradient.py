"""Backward blending: from the gradient of the image to sums per splat, far to near.

Each pair of tile and splat has its own slot of sums, and the slots are added in a fixed order: no atomics, so
the gradient does not depend on threads.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numba.extending import intrinsic

from dfcgs_codec.array_types import Float32
from lab.render.binning import TileLists
from lab.render.blend import BLOCKS, GRAIN, Frame, falloff, span
from lab.render.constants import ALPHA_CAP, ALPHA_CUT, TILE
from lab.render.kernel import kernel, run_in_ranges
from lab.render.projection import BLUE, GREEN, OPACITY, PRECISION, RED, ROW_PRECISION, Splats
from lab.render.simd import LANES, Block, broadcast

# rows of the tile's state: transmittance behind the splat; gradient times the light from behind it; last
# splat; gradient by colour
_TRANSMITTANCE, _BEHIND, _LAST, _G_RED, _G_GREEN, _G_BLUE, _ROWS = range(7)

# Columns of the sums over pixels. With e the gradient by the splat's exponent at a pixel, d the distance from
# the row's peak and dy the height over the centre: e d, e dy, e d^2, e d dy, e dy^2, e; then those by colour.
SUM_D, SUM_DY, SUM_DD, SUM_D_DY, SUM_DY_DY, SUM_E, SUM_RED, SUM_GREEN, SUM_BLUE, SUMS = range(10)


def blend_gradient(
    splats: Splats,
    tiles: TileLists,
    frame: Frame,
    image_gradients: tuple[Float32, Float32, Float32],
    threads: int | None = None,
) -> Float32:
    """Sums over pixels for every Gaussian, (N, 9) float32, zero where it is not drawn.

    image_gradients: by colour, (H, W, 3); by alpha, (H, W); and the background, (3,), all float32.
    """
    slots = np.empty((len(tiles.splats), SUMS), np.float32)
    run_in_ranges(
        _blend_range, len(tiles.starts) - 1, GRAIN, threads, splats, tiles, frame, image_gradients, slots
    )
    sums = np.zeros((len(splats.tiles), SUMS), np.float32)
    _add_slots(tiles.splats, slots, sums)
    return sums


@kernel
def _add_slots(members, slots, sums):
    for slot in range(len(members)):
        for column in range(SUMS):
            sums[members[slot], column] += slots[slot, column]


@kernel
def _blend_range(first, stop, splats, tiles, frame, image_gradients, slots):
    state = np.empty((TILE * BLOCKS, _ROWS, LANES), np.float32)
    lanes = np.empty((1, SUMS, LANES), np.float32)
    for tile in range(first, stop):
        corner = (tile % tiles.columns * TILE, tile // tiles.columns * TILE)
        last = _open_tile(state, corner, frame, image_gradients)
        start = tiles.starts[tile]
        slots[start + last + 1 : tiles.starts[tile + 1]] = 0
        for position in range(last, -1, -1):
            n = tiles.splats[start + position]
            lanes[:] = 0
            _splat_gradient(state, lanes, position, splats.values[n], splats.rects[n], corner)
            for column in range(SUMS):
                slots[start + position, column] = lanes[0, column].sum()


@kernel
def _open_tile(state, corner, frame, image_gradients):
    """Load the tile's pixels; returns the position of the last splat that any of them used."""
    g_colour, g_alpha, background = image_gradients
    state[:] = 0
    state[:, _TRANSMITTANCE] = 1
    state[:, _LAST] = -1
    last = -1
    for y in range(min(TILE, frame.last.shape[0] - corner[1])):
        for x in range(min(TILE, frame.last.shape[1] - corner[0])):
            block, lane = state[y * BLOCKS + x // LANES], x % LANES
            row, column = corner[1] + y, corner[0] + x
            rest = frame.transmittance[row, column]
            light = -g_alpha[row, column]
            for channel in range(3):
                light += g_colour[row, column, channel] * background[channel]
                block[_G_RED + channel, lane] = g_colour[row, column, channel]
            block[_TRANSMITTANCE, lane] = rest
            block[_BEHIND, lane] = rest * light
            block[_LAST, lane] = frame.last[row, column]
            last = max(last, frame.last[row, column])
    return last


@kernel
def _splat_gradient(state, lanes, position, value, rect, corner):
    half_precision = np.float32(0.5) * value[PRECISION]
    half_row = np.float32(0.5) * value[ROW_PRECISION]
    for y in range(max(rect[2] - corner[1], 0), min(rect[3] - corner[1], TILE)):
        first, end, peak, dy = span(value, rect, corner, y)
        for block in range(first, end):
            _block_gradient(
                state,
                lanes,
                y * BLOCKS + block,
                np.float32(block * LANES) - peak,
                half_precision,
                half_row * dy * dy,
                dy,
                value[OPACITY],
                value[RED],
                value[GREEN],
                value[BLUE],
                np.float32(position),
            )


@intrinsic
def _block_gradient(
    typing, state, lanes, block, offset, half_precision, row_term, dy, opacity, red, green, blue, position
):
    """Undo one splat on eight pixels and add to its sums."""

    def generate(context, builder, signature, arguments):
        pixels = Block(context, builder, signature.args[0], arguments[0], arguments[2])
        sums = Block(context, builder, signature.args[1], arguments[1], context.get_constant(types.int64, 0))
        offset, half_precision, row_term, dy, opacity, red, green, blue, position = (
            broadcast(builder, argument) for argument in arguments[3:]
        )
        distance, fall = falloff(builder, offset, half_precision, row_term)
        uncapped = opacity * fall
        alpha = uncapped.at_most(ALPHA_CAP)
        drawn = builder.and_(alpha.compare(">=", ALPHA_CUT), position.compare("<=", pixels.load(_LAST)))
        alpha = alpha.where(drawn, 0.0)
        shown_inverse = (-alpha + 1.0).reciprocal()
        before = pixels.load(_TRANSMITTANCE) * shown_inverse
        weight = alpha * before
        g_red, g_green, g_blue = (pixels.load(row) for row in (_G_RED, _G_GREEN, _G_BLUE))
        light = g_red * red + g_green * green + g_blue * blue
        behind = pixels.load(_BEHIND)
        g_alpha = light * before - behind * shown_inverse
        pixels.store(_BEHIND, behind + weight * light)
        pixels.store(_TRANSMITTANCE, before)
        free = builder.and_(drawn, uncapped.compare("<=", ALPHA_CAP))
        e = (g_alpha * uncapped).where(free, 0.0)
        e_d, e_dy = e * distance, e * dy
        terms = (e_d, e_dy, e_d * distance, e_d * dy, e_dy * dy, e)
        for row, term in enumerate((*terms, weight * g_red, weight * g_green, weight * g_blue)):
            sums.add(row, term)
        return context.get_dummy_value()

    return types.void(state, lanes, types.int64, *[types.float32] * 9), generate
