/** Chunks, sequence header and index (chapters 3, 4 and 7 of bitstream_spec.md). */
import { crc32, Reader } from "./bytes";
import { PlayerError } from "./errors";
import type { Source } from "./source";

const MAGIC = [0x89, 0x44, 0x47, 0x53, 0x0d, 0x0a, 0x1a, 0x0a], FOREIGN = [0x67, 0x6c, 0x70, 0x73];
const VERSION = 11, CRC_BYTES = 4, HEAD_BYTES = 21, END_BYTES = 15, BLOCK = 1 << 20;
const ANCILLARY = 0x80;
export const SEQUENCE_HEADER = 0x01, INTRA_FRAME = 0x10, INTER_FRAME = 0x20, INDEX = 0x7e, END = 0x7f;
const ENCODER_INFO = 0x81, PLY_COMMENTS = 0x82;
const KNOWN = [SEQUENCE_HEADER, INTRA_FRAME, INTER_FRAME, 0x21, 0x22, 0x23, 0x24, 0x25, INDEX, END, ENCODER_INFO, PLY_COMMENTS];

export interface Chunk { type: number; frame: number; offset: number; payloadOffset: number; end: number; payload: Uint8Array }

export interface Sequence {
  profile: number;
  shDegree: number;
  numFrames: number;
  frameRate: number;
  /** numbers of the frames, those of the encoder's input files, as runs [first, count] */
  runs: [number, number][];
  /** positions are doubles in the output */
  isDouble: boolean;
  modelId: string;
  modelHash: string;
}

/** Frames `first` to `first` + `count` - 1, in bytes `start` to `end` - 1. */
export interface Gof { first: number; count: number; start: number; end: number }

export class Container {
  private constructor(
    readonly source: Source, readonly header: Chunk, readonly sequence: Sequence, readonly gofs: Gof[],
  ) {}

  static async open(source: Source): Promise<Container> {
    checkMagic(await source.read(0, MAGIC.length));
    const header = await new ChunkReader(source, MAGIC.length, source.size).next();
    if (header.type !== SEQUENCE_HEADER) throw new PlayerError("corrupt", "the first chunk is not a sequence header", header.offset);
    const sequence = readSequence(new Reader(header.payload, header.payloadOffset));
    return new Container(source, header, sequence, await readIndex(source, header.end, sequence.numFrames));
  }

  /** The place of the GoF that holds a frame. */
  gofOf(frame: number): number { return gofAt(this.gofs, frame); }

  chunksOf(gof: Gof): ChunkReader { return new ChunkReader(this.source, gof.start, gof.end); }
}

export function gofAt(gofs: Gof[], frame: number): number {
  let low = 0, high = gofs.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (gofs[middle].first <= frame) low = middle; else high = middle - 1;
  }
  return low;
}

/** Chunks one after the other, read in blocks. */
export class ChunkReader {
  private bytes = new Uint8Array(0);
  private at = 0;

  constructor(private readonly source: Source, private offset: number, private readonly stop: number) {}

  /** The next known chunk, its checksum found right. */
  async next(): Promise<Chunk> {
    for (;;) {
      const chunk = await this.any();
      if (KNOWN.includes(chunk.type)) return chunk;
      if (!(chunk.type & ANCILLARY))
        throw new PlayerError("unsupported", `chunk type ${chunk.type} is unknown: a newer player is needed`, chunk.offset);
    }
  }

  private async any(): Promise<Chunk> {
    const head = new Reader(await this.ahead(HEAD_BYTES), this.offset, "truncated"), offset = this.offset;
    const type = head.u8(), frame = head.uvarint(), length = head.uvarint(), headBytes = head.position - offset;
    const size = headBytes + length + CRC_BYTES;
    if (offset + size > this.stop && this.stop === this.source.size)
      throw new PlayerError("truncated", `the chunk at byte ${offset} needs more bytes than the file has`, this.stop);
    if (offset + size > this.stop) throw new PlayerError("corrupt", "a chunk reaches into the next GoF", offset);
    const bytes = (await this.ahead(size)).subarray(0, size);
    if (bytes.length < size) throw new PlayerError("truncated", "the file ends inside a chunk", offset + bytes.length);
    const stored = new DataView(bytes.buffer, bytes.byteOffset + size - CRC_BYTES).getUint32(0, true);
    if (crc32(bytes.subarray(0, -CRC_BYTES)) !== stored)
      throw new PlayerError("corrupt", "wrong checksum: the file is damaged here", offset);
    this.at += size;
    this.offset += size;
    return { type, frame, offset, payloadOffset: offset + headBytes, end: this.offset, payload: bytes.subarray(headBytes, -CRC_BYTES) };
  }

  /** At least `count` bytes, fewer only where the part that is read ends. */
  private async ahead(count: number): Promise<Uint8Array> {
    const here = this.bytes.length - this.at;
    if (here < count && this.offset + here < this.stop) {
      const from = this.offset + here, more = await this.source.read(from, Math.min(this.stop, from + Math.max(BLOCK, count - here)));
      const joined = new Uint8Array(here + more.length);
      joined.set(this.bytes.subarray(this.at));
      joined.set(more, here);
      [this.bytes, this.at] = [joined, 0];
    }
    return this.bytes.subarray(this.at);
  }
}

const startsWith = (bytes: Uint8Array, start: number[]) => start.every((value, i) => bytes[i] === value);

function checkMagic(bytes: Uint8Array): void {
  if (startsWith(bytes, FOREIGN)) throw new PlayerError("not-a-dgs-file", "a .dgs file of the dgs-py package, not of dfcgs");
  if (!bytes.every((value, i) => value === MAGIC[i])) throw new PlayerError("not-a-dgs-file", "this is not a dfcgs file");
  if (bytes.length < MAGIC.length) throw new PlayerError("truncated", "the file ends inside its magic number", bytes.length);
}

/** What is not of use here is left for the core to check. */
function readSequence(reader: Reader): Sequence {
  const version = reader.u8();
  if (version !== VERSION)
    throw new PlayerError("unsupported", `bitstream version ${version}, this player reads version ${VERSION}`, reader.position - 1);
  const profile = reader.u8();
  reader.u8();
  const shDegree = reader.u8();
  reader.u8();
  const numFrames = reader.uvarint(), numerator = reader.uvarint(), denominator = reader.uvarint();
  const runs = readRuns(reader, numFrames);
  for (let i = 0; i < 7; i++) reader.uvarint();
  const isDouble = reader.u8() === 1, modelId = new TextDecoder().decode(reader.raw(reader.uvarint()));
  const modelHash = [...reader.raw(8)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  const frameRate = numerator / denominator;
  return { profile, shDegree, numFrames, frameRate: frameRate > 0 ? frameRate : 30, runs, isDouble, modelId, modelHash };
}

function readRuns(reader: Reader, numFrames: number): [number, number][] {
  const runs: [number, number][] = [];
  let end = 0;
  const count = reader.uvarint();
  if (count > numFrames) throw new PlayerError("corrupt", "more runs of frame numbers than frames", reader.position);
  for (let i = 0; i < count; i++) {
    const first = end + reader.uvarint(), length = reader.uvarint() + 1;
    runs.push([first, length]);
    end = first + length;
  }
  return runs;
}

export function numberOf(sequence: Sequence, frame: number): number {
  for (const [first, count] of sequence.runs) {
    if (frame < count) return first + frame;
    frame -= count;
  }
  return frame;
}

async function readIndex(source: Source, least: number, numFrames: number): Promise<Gof[]> {
  const tail = source.size - END_BYTES, cut = new PlayerError("truncated", "the end chunk is missing: the file is cut off", source.size);
  if (tail < least) throw cut;
  const end = await new ChunkReader(source, tail, source.size).next().catch(() => { throw cut; });
  if (end.type !== END || end.end !== source.size) throw cut;
  const at = new Reader(end.payload, end.payloadOffset).u64();
  if (at < least || at >= tail) throw new PlayerError("corrupt", "the index lies outside of the file", end.payloadOffset);
  const chunk = await new ChunkReader(source, at, source.size).next();
  if (chunk.type !== INDEX) throw new PlayerError("corrupt", "the end chunk does not lead to an index", at);
  return gofsOf(new Reader(chunk.payload, chunk.payloadOffset), least, at, numFrames);
}

function gofsOf(reader: Reader, least: number, index: number, numFrames: number): Gof[] {
  const gofs: Gof[] = [], wrong = () => new PlayerError("corrupt", "the index does not fit the file", reader.position);
  const numGofs = reader.uvarint();
  if (numGofs < 1 || numGofs > numFrames) throw wrong();
  let first = 0, start = 0;
  for (let i = 0; i < numGofs; i++) {
    const count = reader.uvarint(), delta = reader.uvarint();
    start += delta;
    if (count < 1 || start < least || start >= index || (i > 0 && delta === 0)) throw wrong();
    if (i) gofs[i - 1].end = start;
    gofs.push({ first, count, start, end: index });
    first += count;
  }
  if (first !== numFrames || reader.left) throw wrong();
  return gofs;
}
