"""Forward blending: the splats of each tile, near to far, into colour and transmittance."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic

from dfcgs_codec.array_types import Float32, Int32
from lab.render.binning import TileLists
from lab.render.camera import Camera
from lab.render.constants import ALPHA_CAP, ALPHA_CUT, TILE, TRANSMITTANCE_STOP
from lab.render.kernel import kernel, run_in_ranges
from lab.render.projection import (
    BLUE,
    GREEN,
    OPACITY,
    PRECISION,
    REACH,
    RED,
    ROW_PRECISION,
    SHEAR,
    Splats,
    U,
    V,
)
from lab.render.simd import LANES, Block, broadcast, lane_numbers

BLOCKS = TILE // LANES
GRAIN = 8
# rows of the tile's state; the transmittance is stored negative once the pixel is finished
_TRANSMITTANCE, _RED, _GREEN, _BLUE, _LAST, _ROWS = range(6)
# splats between two looks at whether all pixels of the tile are finished
_PATIENCE = 16


class Frame(NamedTuple):
    """The image; H rows, W columns.

    colour         (H, W, 3) float32  linear sum of the splats and the background
    transmittance  (H, W)    float32  1 - alpha
    last           (H, W)    int32    position in its tile's list of the last splat that counted; -1: none
    """

    colour: Float32
    transmittance: Float32
    last: Int32


def blend(
    splats: Splats, tiles: TileLists, camera: Camera, background: Float32, threads: int | None = None
) -> Frame:
    """The image of the splats over a background, (3,) float32."""
    shape = (camera.height, camera.width)
    frame = Frame(np.empty((*shape, 3), np.float32), np.empty(shape, np.float32), np.empty(shape, np.int32))
    run_in_ranges(_blend_range, len(tiles.starts) - 1, GRAIN, threads, splats, tiles, background, frame)
    return frame


@kernel
def _blend_range(first, stop, splats, tiles, background, frame):
    state = np.empty((TILE * BLOCKS, _ROWS, LANES), np.float32)
    for tile in range(first, stop):
        x = tile % tiles.columns * TILE
        y = tile // tiles.columns * TILE
        width = min(TILE, frame.last.shape[1] - x)
        height = min(TILE, frame.last.shape[0] - y)
        _open_tile(state, width, height)
        start = tiles.starts[tile]
        for position in range(tiles.starts[tile + 1] - start):
            if position % _PATIENCE == 0 and position > 0 and _finished(state):
                break
            n = tiles.splats[start + position]
            _blend_splat(state, position, splats.values[n], splats.rects[n], (x, y))
        _close_tile(state, x, y, width, height, background, frame)


@kernel
def _open_tile(state, width, height):
    state[:] = 0
    for y in range(TILE):
        for x in range(TILE):
            block = state[y * BLOCKS + x // LANES]
            block[_LAST, x % LANES] = -1
            block[_TRANSMITTANCE, x % LANES] = 1 if x < width and y < height else -1


@kernel
def _finished(state):
    for block in range(TILE * BLOCKS):
        for lane in range(LANES):
            if state[block, _TRANSMITTANCE, lane] > 0:
                return False
    return True


@kernel
def span(value, rect, corner, y):
    """First and end block that a splat reaches in row y of the tile at `corner`, x of its peak there, and dy.

    x is relative to the centre of the tile's first pixel, dy is the row's height over the splat's centre;
    the end is 0 where the splat does not reach the row.
    """
    dy = np.float32(y + corner[1]) + np.float32(0.5) - value[V]
    peak = value[U] - np.float32(0.5) - np.float32(corner[0]) + value[SHEAR] * dy
    left = value[REACH] - value[ROW_PRECISION] * dy * dy
    if not left >= 0:
        return 0, 0, peak, dy
    half = math.sqrt(left / value[PRECISION])
    first = max(np.float32(rect[0] - corner[0]), max(math.ceil(peak - half), np.float32(0)))
    last = min(np.float32(rect[1] - 1 - corner[0]), min(math.floor(peak + half), np.float32(TILE - 1)))
    if first > last:
        return 0, 0, peak, dy
    return int(first) // LANES, int(last) // LANES + 1, peak, dy


@kernel
def _blend_splat(state, position, value, rect, corner):
    half_precision = np.float32(0.5) * value[PRECISION]
    half_row = np.float32(0.5) * value[ROW_PRECISION]
    for y in range(max(rect[2] - corner[1], 0), min(rect[3] - corner[1], TILE)):
        first, end, peak, dy = span(value, rect, corner, y)
        for block in range(first, end):
            _blend_block(
                state,
                y * BLOCKS + block,
                np.float32(block * LANES) - peak,
                half_precision,
                half_row * dy * dy,
                value[OPACITY],
                value[RED],
                value[GREEN],
                value[BLUE],
                np.float32(position),
            )


def falloff(builder, offset, half_precision, row_term):
    """Distance of eight pixels from the row's peak, and the splat's falloff there, at most 1."""
    distance = lane_numbers(builder) + offset
    return distance, (-(half_precision * distance * distance + row_term)).at_most(0.0).exp()


@intrinsic
def _blend_block(typing, state, block, offset, half_precision, row_term, opacity, red, green, blue, position):
    """Blend one splat into eight pixels."""

    def generate(context, builder, signature, arguments):
        pixels = Block(context, builder, signature.args[0], arguments[0], arguments[1])
        offset, half_precision, row_term, opacity, *colour, position = (
            broadcast(builder, argument) for argument in arguments[2:]
        )
        alpha = (opacity * falloff(builder, offset, half_precision, row_term)[1]).at_most(ALPHA_CAP)
        alpha = alpha.where(alpha.compare(">=", ALPHA_CUT), 0.0)
        stored = pixels.load(_TRANSMITTANCE)
        before = stored.at_least(0.0)
        weight = alpha * before
        after = before - weight
        goes_on = after.compare(">", TRANSMITTANCE_STOP)
        weight = weight.where(goes_on, 0.0)
        finished = stored.where(stored.compare("<", 0.0), -stored)
        pixels.store(_TRANSMITTANCE, after.where(goes_on, finished))
        for row, value in zip((_RED, _GREEN, _BLUE), colour, strict=True):
            pixels.add(row, weight * value)
        pixels.store(_LAST, position.where(weight.compare(">", 0.0), pixels.load(_LAST)))
        return context.get_dummy_value()

    return types.void(state, types.int64, *[types.float32] * 8), generate


@kernel
def _close_tile(state, left, top, width, height, background, frame):
    for y in range(height):
        for x in range(width):
            block = state[y * BLOCKS + x // LANES]
            lane = x % LANES
            rest = abs(block[_TRANSMITTANCE, lane])
            frame.transmittance[top + y, left + x] = rest
            frame.last[top + y, left + x] = int(block[_LAST, lane])
            for channel in range(3):
                value = block[_RED + channel, lane] + rest * background[channel]
                frame.colour[top + y, left + x, channel] = value
