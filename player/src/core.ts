/** `core.wasm`: one decoder an instance (core/exports.c; the Python binding is dfcgs_codec/core/module.py). */
import type { Chunk } from "./container";
import { PlayerError, type Code } from "./errors";

/** Arrays of the output, by bit: positions, rotations, scales, opacities, sh_dc, sh_rest. */
export const POSITIONS = 1, ROTATIONS = 2, SCALES = 4, OPACITIES = 8, SH_DC = 16, SH_REST = 32, ALL_ARRAYS = 63;
/** planes of the state that an array is made of, as bits */
const PLANES = [1 << 0, 1 << 2, 1 << 1, 1 << 3, 1 << 4, (1 << 5) | (1 << 6) | (1 << 7)];
const ORDER = 1 << 8;
const MOST_MEMORY = 0xffffffff, DEFAULT_MEMORY = 2n ** 31n;
/** offsets in the record `info` of core/exports.c */
const OFFSET = 0, EXCESS_KIND = 36, MESSAGE = 40, EXPECTS = 52, COUNT = 56, PATTERNS = 68, TOUCHED = 72;
const ESCAPES = 144, ARRAYS = 152, RECORD_BYTES = 176;
const CODES: Record<number, Code> = { 1: "corrupt", 2: "truncated", 3: "unsupported", 4: "limit", 5: "model-mismatch" };
const HASH = 6, MEMORY = 7, RESOURCES = 8;
const EXCESS = ["", "has too many Gaussians", "needs too much memory", "asks for more memory than its bytes pay for",
  "asks for more work than its bytes pay for"];

interface Exports {
  memory: WebAssembly.Memory;
  core_info(): number;
  core_reset(limit: number): void;
  core_room(size: number): number;
  core_open(words: number, count: number): number;
  core_begin(payload: number, size: number, offset: bigint, maxMemory: bigint, maxGaussians: bigint, check: number): number;
  core_payload(type: number, size: number): number;
  core_put(type: number, frame: number, offset: bigint, payloadOffset: bigint, size: bigint, payload: number, payloadSize: number): number;
  core_output(wanted: number): number;
}

export class Core {
  private readonly core: Exports;
  private readonly info: number;
  /** arrays that are not those of the last output, as bits */
  private stale = ALL_ARRAYS;

  constructor(module: WebAssembly.Module, model: Uint8Array, header: Chunk, check: boolean) {
    this.core = new WebAssembly.Instance(module).exports as unknown as Exports;
    this.info = this.core.core_info();
    this.core.core_reset(MOST_MEMORY);
    const words = this.put(this.core.core_room(model.length), model);
    this.called(this.core.core_open(words, model.length / 4));
    const payload = this.put(this.core.core_room(header.payload.length), header.payload);
    this.called(this.core.core_begin(payload, header.payload.length, BigInt(header.payloadOffset), DEFAULT_MEMORY, -1n, Number(check)));
  }

  /** What follows begins with an I-frame, with which the core forgets what was before. */
  forget(): void { this.stale = ALL_ARRAYS; }

  /** Takes a chunk; returns the type of the one that the frame needs next, 0 where it is whole. */
  take(chunk: Chunk): number {
    const { type, frame, payload } = chunk;
    const at = this.put(this.core.core_payload(type, payload.length), payload);
    const [offset, payloadOffset, size] = [chunk.offset, chunk.payloadOffset, chunk.end - chunk.offset].map(BigInt);
    this.called(this.core.core_put(type, frame, offset, payloadOffset, size, at, payload.length), chunk);
    const expects = this.int(EXPECTS);
    if (!expects) this.finish();
    return expects;
  }

  get count(): number { return this.int(COUNT); }

  /** Arrays that changed since the last output and are wanted, by bit; they are lost with the next chunk. */
  output(wanted: number, isDouble: boolean, degree: number): (Float32Array | Float64Array | undefined)[] {
    const fresh = wanted & this.stale, rest = 3 * degree * (degree + 2);
    if (fresh) this.called(this.core.core_output(fresh));
    this.stale = this.isExact ? ALL_ARRAYS : this.stale & ~fresh;
    return [3, 4, 3, 1, 3, rest].map((width, i) => {
      if (!((fresh >> i) & 1)) return undefined;
      const Kind = i === 0 && isDouble ? Float64Array : Float32Array;
      return new Kind(this.core.memory.buffer, this.int(ARRAYS + 4 * i) >>> 0, width * this.count);
    });
  }

  /** Float values stand as they were in the input: no array is that of another frame. */
  private get isExact(): boolean { return this.int(PATTERNS) !== 0 || this.int(ESCAPES) !== 0; }

  private finish(): void {
    const touched = this.int(TOUCHED);
    PLANES.forEach((planes, i) => { if (touched & planes) this.stale |= 1 << i; });
    if (touched & ORDER || this.isExact) this.stale = ALL_ARRAYS;
  }

  private put(address: number, bytes: Uint8Array): number {
    if (!address) throw memory();
    new Uint8Array(this.core.memory.buffer, address >>> 0, bytes.length).set(bytes);
    return address;
  }

  private int(offset: number): number { return new DataView(this.core.memory.buffer, this.info, RECORD_BYTES).getInt32(offset, true); }

  private called(status: number, chunk?: Chunk): void {
    if (!status) return;
    const offset = Number(new DataView(this.core.memory.buffer, this.info).getBigInt64(OFFSET, true)), where = offset < 0 ? undefined : offset;
    if (status in CODES) throw new PlayerError(CODES[status], this.text(this.int(MESSAGE) >>> 0), where);
    if (status === HASH) throw new PlayerError("verification", `frame ${chunk?.frame} decodes to other values than its encoder had`, where);
    if (status === MEMORY) throw memory();
    if (status === RESOURCES) throw new PlayerError("resources", `frame ${chunk?.frame} ${EXCESS[this.int(EXCESS_KIND)]}`);
    throw new Error(`the core refused a call of its own player: ${status}`);
  }

  private text(address: number): string {
    const bytes = new Uint8Array(this.core.memory.buffer, address);
    return address ? new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0))) : "";
  }
}

const memory = () => new PlayerError("resources", "the frames need more memory than the browser gives");
