/** Order of drawing: far to near, by view depth. */
import type { Lens } from "./camera";

const DIGIT = 11, BINS = 1 << DIGIT, MASK = BINS - 1;
/** of the bits of a positive float the last ones do not count: depths that differ by less than 1 in 2**14 are alike */
const DROPPED = 31 - 2 * DIGIT;

export interface Order { order: Uint32Array; visible: number }

/** A stable radix sort, nearest last. `moving`: four words a Gaussian, the first three its position. Gaussians before the near
 *  plane, or without a finite depth, are left out. */
export class Sorter {
  private keys = new Uint32Array(0);
  private first = new Uint32Array(0);
  private ids = new Uint32Array(0);
  private readonly low = new Uint32Array(BINS);
  private readonly high = new Uint32Array(BINS);

  sort(moving: Uint32Array, count: number, camera: Lens, order: Uint32Array): number {
    if (this.keys.length < count) [this.keys, this.first, this.ids] = [0, 0, 0].map(() => new Uint32Array(count));
    const visible = this.collect(new Float32Array(moving.buffer, moving.byteOffset, count * 4), count, camera);
    const { keys, first, ids, low, high } = this;
    cumulate(low);
    cumulate(high);
    for (let n = 0; n < visible; n++) first[low[keys[n] & MASK]++] = n;
    for (let n = 0; n < visible; n++) { const k = first[n]; order[high[keys[k] >>> DIGIT]++] = ids[k]; }
    return visible;
  }

  /** Keys, which rise from far to near, and how often their digits occur. */
  private collect(floats: Float32Array, count: number, { view, near }: Lens): number {
    const { keys, ids, low, high } = this, [a, b, c, d] = view.slice(8, 12);
    const depth = new Float32Array(count), bits = new Uint32Array(depth.buffer);
    low.fill(0);
    high.fill(0);
    let n = 0;
    for (let i = 0, k = 0; i < count; i++, k += 4) {
      const z = a * floats[k] + b * floats[k + 1] + c * floats[k + 2] + d;
      if (!(z >= near && z < 1e30)) continue;
      depth[n] = z;
      const key = (0x7fffffff - bits[n]) >>> DROPPED;
      keys[n] = key;
      ids[n++] = i;
      low[key & MASK]++;
      high[key >>> DIGIT]++;
    }
    return n;
  }
}

/** Counts become the places where each bin begins. */
function cumulate(bins: Uint32Array): void {
  let sum = 0;
  for (let i = 0; i < BINS; i++) { const n = bins[i]; bins[i] = sum; sum += n; }
}
