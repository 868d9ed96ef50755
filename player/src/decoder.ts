/** Frames of a file, as typed arrays. */
import { Container, INTER_FRAME, INTRA_FRAME, numberOf, type Chunk, type ChunkReader, type Sequence } from "./container";
import { ALL_ARRAYS, Core } from "./core";
import { PlayerError } from "./errors";
import { openSource } from "./source";

/** The core and the models that it knows, each by id and hash. */
export interface Assets { module: WebAssembly.Module; models: Model[] }
export interface Model { id: string; hash: string; words: Uint8Array }

/** A decoded frame; the arrays are the caller's. */
export interface Frame {
  index: number;
  /** that of the encoder's input file */
  number: number;
  count: number;
  shDegree: number;
  /** 3 a Gaussian */
  positions: Float32Array | Float64Array;
  /** 4 a Gaussian: w, x, y, z, of length 1 */
  rotations: Float32Array;
  /** 3 a Gaussian: natural logarithms */
  scales: Float32Array;
  /** logits */
  opacities: Float32Array;
  /** 3 a Gaussian */
  shDc: Float32Array;
  /** per Gaussian all red coefficients of degrees 1 and above, then all green, then all blue: as f_rest_* of PLY files */
  shRest: Float32Array;
}

/** Decodes frames in any order; consecutive ones of a GoF without going back. */
export class FrameDecoder {
  private readonly core: Core;
  private chunks?: ChunkReader;
  private gof = -1;
  /** the frame that comes next in the GoF */
  next = -1;
  private bytes = 0;

  private constructor(readonly container: Container, assets: Assets, check: boolean) {
    this.core = new Core(assets.module, modelOf(container.sequence, assets.models), container.header, check);
  }

  static async open(from: string | Blob, assets: Assets, check = true): Promise<FrameDecoder> {
    return new FrameDecoder(await Container.open(await openSource(from)), assets, check);
  }

  get sequence(): Sequence { return this.container.sequence; }
  get count(): number { return this.core.count; }

  /** Decodes one frame towards `index`; whether that is done now. */
  async advance(index: number): Promise<boolean> {
    const gof = this.container.gofOf(index), { first } = this.container.gofs[gof];
    if (gof !== this.gof || this.next > index || this.next < first) this.restart(gof);
    try {
      await this.decode();
    } catch (error) {
      this.gof = -1;
      throw error;
    }
    return this.next === index + 1;
  }

  /** Arrays that changed since they were taken last; see Core. */
  output(wanted: number): (Float32Array | Float64Array | undefined)[] {
    return this.core.output(wanted, this.sequence.isDouble, this.sequence.shDegree);
  }

  /** Bytes of chunks since this was asked last. */
  takeBytes(): number {
    const { bytes } = this;
    this.bytes = 0;
    return bytes;
  }

  private restart(gof: number): void {
    this.core.forget();
    [this.gof, this.chunks, this.next] = [gof, this.container.chunksOf(this.container.gofs[gof]), this.container.gofs[gof].first];
  }

  private async decode(): Promise<void> {
    const { first } = this.container.gofs[this.gof];
    let chunk = await this.frameChunk();
    const wanted = this.next === first ? INTRA_FRAME : INTER_FRAME;
    if (chunk.type !== wanted || chunk.frame !== this.next)
      throw new PlayerError("corrupt", `frame ${this.next} is not where the index says`, chunk.offset);
    for (;;) {
      this.bytes += chunk.end - chunk.offset;
      const expects = this.core.take(chunk);
      if (!expects) break;
      chunk = await this.chunks!.next();
      if (chunk.type !== expects || chunk.frame !== this.next)
        throw new PlayerError("corrupt", `frame ${this.next} lacks a chunk`, chunk.offset);
    }
    this.next++;
  }

  private async frameChunk(): Promise<Chunk> {
    for (;;) {
      const chunk = await this.chunks!.next();
      if (chunk.type < 0x80) return chunk;
    }
  }
}

const PAPER = 1;

function modelOf(sequence: Sequence, models: Model[]): Uint8Array {
  if (sequence.profile === PAPER)
    throw new PlayerError("unsupported", "profile paper cannot be played here: `dfcgs decode` makes PLY files of it");
  const model = models.find(({ id }) => id === sequence.modelId);
  if (!model) throw new PlayerError("model-mismatch", `model '${sequence.modelId}' is unknown: another version of the player may have it`);
  if (!model.hash.startsWith(sequence.modelHash))
    throw new PlayerError("model-mismatch", `coded with another version of model '${sequence.modelId}'`);
  return model.words;
}

/** All frames of a file, or frames `start` to `stop` - 1. */
export async function* framesOf(
  from: string | Blob, assets: Assets, { start = 0, stop = Infinity, check = true } = {},
): AsyncGenerator<Frame> {
  const decoder = await FrameDecoder.open(from, assets, check), { sequence } = decoder;
  let last: (Float32Array | Float64Array)[] = [];
  for (let index = start; index < Math.min(stop, sequence.numFrames); index++) {
    while (!(await decoder.advance(index)));
    last = decoder.output(ALL_ARRAYS).map((array, i) => array?.slice() ?? last[i].slice());
    const [positions, rotations, scales, opacities, shDc, shRest] = last as Float32Array[];
    yield {
      index, number: numberOf(sequence, index), count: decoder.count, shDegree: sequence.shDegree,
      positions, rotations, scales, opacities, shDc, shRest,
    };
  }
}
