/** The two kinds of workers: one decodes and packs, one sorts. The first message says which. */
import type { Gof, Sequence } from "./container";
import { OPACITIES, POSITIONS, ROTATIONS, SCALES, SH_DC, SH_REST } from "./core";
import { FrameDecoder, type Assets } from "./decoder";
import { plain, type PlainError } from "./errors";
import type { Lens } from "./camera";
import { packFixed, packMoving, packSh, type Part } from "./pack";
import { Sorter } from "./sort";

/** To a decoder: what to open, then again and again the frames that are wanted, in this order. `seen`: how many frames of it
 *  have arrived, since others may be under way. */
export interface Open { open: string | Blob; assets: Assets }
export interface Want { want: number[]; seen: number }

/** From a decoder. `fixed` and `sh` have data where the last frame had others. `ms`: decoding, packing. */
export interface Opened { sequence: Sequence; gofs: Gof[]; size: number }
export interface Decoded {
  index: number; count: number; origin: readonly number[]; moving: Uint32Array;
  fixed: Part<Float32Array | undefined>; sh: Part<Uint32Array | undefined>;
  ms: { decode: number; pack: number }; bytes: number;
}
export interface Failed { error: PlainError; index?: number }
export type FromDecoder = { opened: Opened } | { frame: Decoded } | { failed: Failed };

/** To the sorter: a frame, or the index of the last one again; from it: the order. */
export interface ToSort { index: number; camera: Lens; count?: number; moving?: Uint32Array }
export interface Sorted { index: number; order: Uint32Array; visible: number; ms: number }

const send = (message: FromDecoder | Sorted, transfer: ArrayBufferLike[] = []) =>
  (self as unknown as Worker).postMessage(message, transfer as Transferable[]);

const breath = new MessageChannel();
/** Lets messages in. */
const pause = () => new Promise<void>((done) => { breath.port1.onmessage = () => done(); breath.port2.postMessage(0); });

class DecodingWorker {
  private wanted: number[] = [];
  private sent: number[] = [];
  private numSeen = 0;
  private busy = false;
  private origin: readonly number[] = [0, 0, 0];
  private fixedId = -1;
  private shId = -1;
  private arrays: (Float32Array | Float64Array | undefined)[] = [];
  private spent = 0;

  private constructor(private readonly decoder: FrameDecoder) {}

  static async open({ open, assets }: Open): Promise<DecodingWorker> {
    const decoder = await FrameDecoder.open(open, assets), { sequence, container } = decoder;
    send({ opened: { sequence, gofs: container.gofs, size: container.source.size } });
    return new DecodingWorker(decoder);
  }

  /** Replaces the wishes; those that are under way to the page already are none any more. */
  want({ want, seen }: Want): void {
    this.sent.splice(0, seen - this.numSeen);
    this.numSeen = seen;
    this.wanted = want.filter((index) => !this.sent.includes(index));
    if (!this.busy) void this.work();
  }

  private async work(): Promise<void> {
    this.busy = true;
    while (this.wanted.length) {
      const index = this.wanted[0];
      try {
        const start = performance.now(), done = await this.decoder.advance(index);
        this.spent += performance.now() - start;
        if (done) this.deliver(index);
      } catch (error) {
        this.wanted = [];
        this.fixedId = this.shId = -1;
        this.arrays = [];
        send({ failed: { error: plain(error), index: this.decoder.next } });
      }
      await pause();
    }
    this.busy = false;
  }

  private deliver(index: number): void {
    const start = performance.now(), { decoder } = this, { count } = decoder;
    const fresh = decoder.output(POSITIONS | ROTATIONS | SCALES | OPACITIES | SH_DC | SH_REST);
    const [positions, rotations, scales, opacities, shDc, shRest] = this.latest(fresh);
    if (fresh[0] && decoder.sequence.isDouble && this.fixedId < 0) this.origin = finite(positions.slice(0, 3));
    const moving = packMoving(count, positions, rotations as Float32Array, this.origin), transfer: ArrayBufferLike[] = [moving.buffer];
    let fixed: Float32Array | undefined, sh: Uint32Array | undefined;
    if (fresh[2] || fresh[3] || this.fixedId < 0) {
      fixed = packFixed(count, scales as Float32Array, opacities as Float32Array);
      this.fixedId = index;
      transfer.push(fixed.buffer);
    }
    if (fresh[4] || fresh[5]?.length || this.shId < 0) {
      sh = packSh(count, decoder.sequence.shDegree, shDc as Float32Array, shRest as Float32Array);
      this.shId = index;
      transfer.push(sh.buffer);
    }
    const ms = { decode: this.spent, pack: performance.now() - start };
    this.spent = 0;
    this.wanted = this.wanted.filter((other) => other !== index);
    this.sent.push(index);
    send({ frame: {
      index, count, origin: this.origin, moving, fixed: { id: this.fixedId, data: fixed }, sh: { id: this.shId, data: sh }, ms,
      bytes: decoder.takeBytes(),
    } }, transfer);
  }

  /** Arrays of this frame: views of those that are new, copies of others that will be needed beside them. */
  private latest(fresh: (Float32Array | Float64Array | undefined)[]): (Float32Array | Float64Array)[] {
    this.arrays = fresh.map((array, i) => array?.slice() ?? this.arrays[i]);
    return this.arrays as (Float32Array | Float64Array)[];
  }
}

const finite = (values: ArrayLike<number>) => Array.from(values, (value) => (Number.isFinite(value) ? value : 0));

class SortingWorker {
  private readonly sorter = new Sorter();
  private frame?: Required<Pick<ToSort, "count" | "moving">>;

  sort({ index, camera, count, moving }: ToSort): void {
    const start = performance.now();
    if (moving) this.frame = { count: count!, moving };
    const frame = this.frame!, order = new Uint32Array(frame.moving.length / 4);
    const visible = this.sorter.sort(frame.moving, frame.count, camera, order);
    send({ index, order, visible, ms: performance.now() - start }, [order.buffer]);
  }
}

let worker: Promise<DecodingWorker> | undefined;
const sorting = new SortingWorker();

self.onmessage = ({ data }: MessageEvent<Open | Want | ToSort>) => {
  if ("open" in data) {
    worker = DecodingWorker.open(data);
    worker.catch((error) => send({ failed: { error: plain(error) } }));
  } else if ("want" in data) void worker?.then((one) => one.want(data), () => {});
  else sorting.sort(data);
};
