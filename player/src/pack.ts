/** Frames as the graphics card reads them: textures of `ROW` Gaussians a row. */

/** Gaussians a row of a texture */
export const ROW = 2048;

export const rowsOf = (count: number): number => Math.max(1, Math.ceil(count / ROW));
/** texels of SH coefficients a Gaussian: 8 halves each */
export const texelsOf = (degree: number): number => Math.ceil((3 * (degree + 1) ** 2) / 8);

/** Something that is the same in several frames: `id` is the frame that it came with. */
export interface Part<T> { id: number; data: T }

/** One frame. `moving`: x, y, z as float bits, and the rotation in 32 bits; `fixed`: standard deviations and alpha;
 *  `sh`: halves, of row r the texels k in row `r * texelsOf(degree) + k`. */
export interface PackedFrame {
  index: number;
  count: number;
  moving: Uint32Array;
  fixed: Part<Float32Array>;
  sh: Part<Uint32Array>;
}

const BASE = new Uint16Array(512), SHIFT = new Uint8Array(512);
for (let i = 0; i < 256; i++) {
  const e = i - 127;
  const [base, shift] = e < -24 ? [0, 24] : e < -14 ? [0x400 >> (-e - 14), -e - 1] : e <= 15 ? [(e + 15) << 10, 13] : [0x7bff, 24];
  BASE[i] = base;
  BASE[i | 256] = base | 0x8000;
  SHIFT[i] = SHIFT[i | 256] = shift;
}

/** float32 bits to float16, halves rounded up, too large ones to the largest */
function half(b: number): number {
  if (SHIFT[b >>> 23] === 13) b += 0x1000;
  const k = (b >>> 23) & 511;
  return BASE[k] + ((b & 0x7fffff) >>> SHIFT[k]);
}

const SMALL = 511 * Math.SQRT2;

/** Rotation as the three smallest of w, x, y, z in 10 bits each, and which one is left out. */
function rotationBits(q: Float32Array, k: number): number {
  const w = q[k], x = q[k + 1], y = q[k + 2], z = q[k + 3], ww = w * w, xx = x * x, yy = y * y, zz = z * z;
  let big = 0, a = x, b = y, c = z, lead = w, most = ww;
  if (xx > most) { big = 1; a = w; lead = x; most = xx; }
  if (yy > most) { big = 2; a = w; b = x; lead = y; most = yy; }
  if (zz > most) { big = 3; a = w; b = x; c = y; lead = z; most = zz; }
  const length = Math.sqrt(ww + xx + yy + zz), s = (lead < 0 ? -SMALL : SMALL) / length;
  if (!(length > 0)) return 511 << 20 | 511 << 10 | 511;
  return (big << 30) | ((a * s + 511.5) << 20) | ((b * s + 511.5) << 10) | (c * s + 511.5);
}

/** `origin`: subtracted from positions */
export function packMoving(
  count: number, positions: Float32Array | Float64Array, rotations: Float32Array, origin: readonly number[],
): Uint32Array {
  const out = new Uint32Array(rowsOf(count) * ROW * 4), floats = new Float32Array(out.buffer), [ox, oy, oz] = origin;
  for (let i = 0, o = 0, p = 0; i < count; i++, o += 4, p += 3) {
    floats[o] = positions[p] - ox;
    floats[o + 1] = positions[p + 1] - oy;
    floats[o + 2] = positions[p + 2] - oz;
    out[o + 3] = rotationBits(rotations, o);
  }
  return out;
}

export function packFixed(count: number, scales: Float32Array, opacities: Float32Array): Float32Array {
  const out = new Float32Array(rowsOf(count) * ROW * 4);
  for (let i = 0, o = 0, s = 0; i < count; i++, o += 4, s += 3) {
    out[o] = Math.exp(scales[s]);
    out[o + 1] = Math.exp(scales[s + 1]);
    out[o + 2] = Math.exp(scales[s + 2]);
    out[o + 3] = 1 / (1 + Math.exp(-opacities[i]));
  }
  return out;
}

/** Coefficients in the order of PLY files: degree 0, then channel by channel. */
export function packSh(count: number, degree: number, shDc: Float32Array, shRest: Float32Array): Uint32Array {
  const rest = 3 * degree * (degree + 2), texels = texelsOf(degree), halves = new Uint16Array(rowsOf(count) * ROW * texels * 8);
  const dc = new Uint32Array(shDc.buffer, shDc.byteOffset, shDc.length);
  const others = new Uint32Array(shRest.buffer, shRest.byteOffset, shRest.length);
  for (let i = 0, r = 0; i < count; i++) {
    const row = (i / ROW) | 0, first = (row * texels * ROW + (i - row * ROW)) * 8;
    for (let k = 0; k < 3; k++) halves[first + k] = half(dc[3 * i + k]);
    for (let k = 3; k < rest + 3; k++) halves[first + (k >> 3) * ROW * 8 + (k & 7)] = half(others[r++]);
  }
  return new Uint32Array(halves.buffer);
}
