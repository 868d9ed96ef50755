/** Frames of a file, decoded ahead by two workers and kept as long as memory allows. */
import code from "worker:code";
import { gofAt, type Gof, type Sequence } from "./container";
import type { Assets } from "./decoder";
import { PlayerError, raised } from "./errors";
import type { PackedFrame, Part } from "./pack";
import type { Decoded, FromDecoder, Open, Opened, Want } from "./worker";

let url: string | undefined;

export function startWorker(): Worker {
  url ??= URL.createObjectURL(new Blob([code], { type: "text/javascript" }));
  return new Worker(url);
}

/** frames that a worker is told of at once */
const WISHES = 3;

/** One decoding worker: what it sent last, and how many frames it sent. */
class Decoder {
  readonly worker = startWorker();
  seen = 0;
  asked = "";
  fixed?: Part<Float32Array>;
  sh?: Part<Uint32Array>;

  want(want: number[]): void {
    const asked = want.join();
    if (asked === this.asked) return;
    this.asked = asked;
    this.worker.postMessage({ want, seen: this.seen } satisfies Want);
  }

  /** Parts that did not come with this frame are those of the one before. */
  complete({ index, count, moving, fixed, sh }: Decoded): PackedFrame {
    this.seen++;
    this.asked = "";
    this.fixed = fixed.data ? (fixed as Part<Float32Array>) : this.fixed!;
    this.sh = sh.data ? (sh as Part<Uint32Array>) : this.sh!;
    return { index, count, moving, fixed: this.fixed, sh: this.sh };
  }
}

export interface StreamEvents {
  frame(frame: PackedFrame, ms: { decode: number; pack: number }): void;
  /** `errorAt` has something to say */
  failed(): void;
}

export class FrameStream {
  readonly sequence: Sequence;
  readonly gofs: Gof[];
  readonly size: number;
  private readonly frames = new Map<number, PackedFrame>();
  /** by GoF: the first frame that cannot be decoded, and why */
  private readonly broken = new Map<number, { index: number; error: PlayerError }>();
  private frameBytes = 1;
  private target = 0;
  private isLooping = true;
  bytesRead = 0;

  private constructor(private readonly decoders: Decoder[], opened: Opened, private readonly events: StreamEvents, private readonly budget: number) {
    ({ sequence: this.sequence, gofs: this.gofs, size: this.size } = opened);
    for (const decoder of decoders) decoder.worker.onmessage = ({ data }: MessageEvent<FromDecoder>) => this.receive(decoder, data);
  }

  /** `budget`: bytes of frames that are kept */
  static async open(from: string | Blob, assets: Assets, events: StreamEvents, budget: number): Promise<FrameStream> {
    const first = new Decoder(), decoders = [first];
    try {
      const opened = await opening(first, from, assets);
      if (opened.gofs.length > 1) {
        decoders.push(new Decoder());
        await opening(decoders[1], from, assets);
      }
      return new FrameStream(decoders, opened, events, budget);
    } catch (error) {
      for (const { worker } of decoders) worker.terminate();
      throw error;
    }
  }

  close(): void { for (const { worker } of this.decoders) worker.terminate(); }

  get(index: number): PackedFrame | undefined { return this.frames.get(index); }
  /** Why a frame cannot be decoded, where that is known. */
  errorAt(index: number): PlayerError | undefined {
    const found = this.broken.get(this.gofOf(index));
    return found && index >= found.index ? found.error : undefined;
  }
  gofOf(index: number): number { return gofAt(this.gofs, index); }
  keyOf(index: number): number { return this.gofs[this.gofOf(index)].first; }

  /** How many frames from `index` on are there. */
  ready(index: number): number {
    let count = 0;
    while (count < this.sequence.numFrames && this.frames.has(this.wrapped(index + count))) count++;
    return count;
  }

  /** Says what is shown or will be next: frames are decoded from there on, its key frame first if it `isJump`. */
  aim(index: number, isLooping: boolean, isJump: boolean): void {
    [this.target, this.isLooping] = [index, isLooping];
    this.evict();
    this.ask(isJump && !this.frames.has(index) ? this.keyOf(index) : undefined);
  }

  private wrapped(index: number): number { return this.isLooping ? index % this.sequence.numFrames : index; }

  /** Frames that are kept from the target on. */
  private get room(): number { return Math.max(3, Math.min(this.sequence.numFrames, Math.floor(this.budget / this.frameBytes))); }

  private ask(key?: number): void {
    const { numFrames } = this.sequence, wishes: number[][] = this.decoders.map(() => []);
    const add = (index: number) => {
      const mine = wishes[this.gofOf(index) % this.decoders.length];
      if (!this.frames.has(index) && !this.errorAt(index) && mine.length < WISHES && !mine.includes(index)) mine.push(index);
    };
    if (key !== undefined) add(key);
    for (let i = 0; i < this.room && wishes.some((mine) => mine.length < WISHES); i++) {
      const index = this.wrapped(this.target + i);
      if (index >= numFrames) break;
      add(index);
    }
    // whoever has nothing to do makes a start with the next GoF
    const after = this.gofOf(this.target) + 1, next = after < this.gofs.length ? after : this.isLooping ? 0 : -1;
    if (next >= 0 && (next - after + 1) % this.decoders.length) add(this.gofs[next].first);
    this.decoders.forEach((decoder, i) => decoder.want(wishes[i]));
  }

  /** How far behind the target a frame is, in the direction of play. */
  private distance(index: number): number { return (index - this.target + this.sequence.numFrames) % this.sequence.numFrames; }

  private evict(): void {
    if (this.frames.size <= this.room + 1) return;
    const far = [...this.frames.keys()].sort((a, b) => this.distance(b) - this.distance(a));
    for (const index of far.slice(0, this.frames.size - this.room - 1)) this.frames.delete(index);
  }

  private receive(decoder: Decoder, data: FromDecoder): void {
    if ("failed" in data) return this.fail(decoder, data.failed.index ?? this.target, raised(data.failed.error));
    if (!("frame" in data)) return;
    const frame = decoder.complete(data.frame), own = frame.moving.byteLength;
    const parts = [data.frame.fixed.data, data.frame.sh.data].reduce((sum, part) => sum + (part?.byteLength ?? 0), 0);
    // parts that are rarely new weigh less; a change of habits is followed within some frames
    this.frameBytes = Math.max(own, 0.9 * this.frameBytes + 0.1 * (own + parts));
    this.bytesRead += data.frame.bytes;
    this.frames.set(frame.index, frame);
    this.evict();
    this.events.frame(frame, data.frame.ms);
    this.ask();
  }

  private fail(decoder: Decoder, index: number, error: PlayerError): void {
    this.broken.set(this.gofOf(index), { index, error });
    this.events.failed();
    decoder.asked = "";
    this.ask();
  }
}

function opening({ worker }: Decoder, from: string | Blob, assets: Assets): Promise<Opened> {
  return new Promise((done, refuse) => {
    worker.onmessage = ({ data }: MessageEvent<FromDecoder>) => {
      if ("opened" in data) done(data.opened);
      if ("failed" in data) refuse(raised(data.failed.error));
    };
    worker.onerror = (event) => refuse(new PlayerError("browser", `a worker does not start: ${event.message ?? "refused"}`));
    // addresses in a worker that comes from a Blob are relative to nothing
    worker.postMessage({ open: typeof from === "string" ? new URL(from, document.baseURI).href : from, assets } satisfies Open);
  });
}
