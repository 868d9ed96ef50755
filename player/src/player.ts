/** Plays a file on a canvas: clock, camera, and the rule that a frame is shown only with its own order. */
import { OrbitCamera } from "./camera";
import type { Assets } from "./decoder";
import { PlayerError } from "./errors";
import type { PackedFrame } from "./pack";
import { Renderer, type Look } from "./renderer";
import { FrameStream, startWorker } from "./stream";
import type { Sorted, ToSort } from "./worker";

const SMALL_SCREEN = 800, MEBIBYTE = 1 << 20;
/** bytes of frames that are kept on large and on small screens */
const BUDGETS = [512 * MEBIBYTE, 160 * MEBIBYTE];
const LONGEST_TICK = 250;

/** Times in milliseconds, those of the last frame of each kind; `frames`: pictures a second. */
export interface Statistics {
  decode: number; pack: number; sort: number; upload: number; draw: number; pictures: number; ahead: number; gaussians: number;
  bytesPerSecond: number; firstPicture: number;
}

export interface PlayerEvents {
  opened(): void;
  /** another frame is shown, or play began or ended */
  changed(): void;
  moved(): void;
  waiting(isWaiting: boolean): void;
  failed(error: PlayerError): void;
}

export class Player {
  readonly camera = new OrbitCamera();
  readonly statistics: Statistics = {
    decode: 0, pack: 0, sort: 0, upload: 0, draw: 0, pictures: 0, ahead: 0, gaussians: 0, bytesPerSecond: 0, firstPicture: 0,
  };
  isPlaying = false;
  isLooping = true;
  speed = 1;
  /** pixels of the picture for each one of the page */
  density?: number;
  /** the frame that is seen, -1 for none */
  shown = -1;
  private stream?: FrameStream;
  private renderer?: Renderer;
  private sorter?: Worker;
  private readonly gl: WebGL2RenderingContext;
  private position = 0;
  private seeks = false;
  /** the frame that is being sorted, -1 for none */
  private sorting = -1;
  private sorterHas?: PackedFrame;
  private sorted?: Sorted;
  private isDirty = true;
  private needsOrder = false;
  private isFramed = false;
  private last = 0;
  private ticks = 0;
  private started = 0;
  private ended = false;
  /** how many files were opened */
  private turn = 0;

  constructor(private readonly canvas: HTMLCanvasElement, private readonly assets: Promise<Assets>, private readonly events: PlayerEvents) {
    this.gl = Renderer.context(canvas);
    canvas.addEventListener("webglcontextlost", () => this.fail(new PlayerError("browser", "the graphics card was reset: reload the page")));
    requestAnimationFrame(this.tick);
  }

  /** Opens a file; the last one goes. */
  async open(from: string | Blob): Promise<void> {
    this.started = performance.now();
    this.stream?.close();
    this.stream = undefined;
    [this.shown, this.position, this.sorting, this.sorted, this.isFramed] = [-1, 0, -1, undefined, this.isPosed];
    const budget = BUDGETS[Number(Math.min(screen.width, screen.height) < SMALL_SCREEN)];
    const turn = ++this.turn, received = { frame: this.receive, failed: () => this.check() };
    try {
      const stream = await FrameStream.open(from, await this.assets, received, budget);
      if (turn !== this.turn) return stream.close();
      this.stream = stream;
      this.renderer?.free();
      this.renderer = Renderer.on(this.gl, this.stream.sequence.shDegree);
      this.startSorter();
    } catch (error) {
      return this.fail(PlayerError.of(error));
    }
    this.events.opened();
    this.aim(true);
  }

  /** The camera is set by whoever uses the player: it is left where it is. */
  isPosed = false;

  close(): void {
    this.ended = true;
    this.stream?.close();
    this.sorter?.terminate();
  }

  get numFrames(): number { return this.stream?.sequence.numFrames ?? 0; }
  get shDegree(): number { return this.stream?.sequence.shDegree ?? 0; }
  get frameRate(): number { return this.stream?.sequence.frameRate ?? 30; }
  /** the frame that is wanted */
  get frame(): number { return Math.min(Math.floor(this.position), Math.max(0, this.numFrames - 1)); }

  /** What is seen is the frame that is wanted, in its order: nothing will change by itself. */
  get isSettled(): boolean {
    return !this.isPlaying && this.shown === this.frame && this.sorting < 0 && !this.sorted && !this.needsOrder && !this.isDirty;
  }

  play(): void {
    if (!this.isLooping && this.frame === this.numFrames - 1) this.position = 0;
    this.isPlaying = true;
    this.events.changed();
  }

  pause(): void {
    if (this.isPlaying && this.shown >= 0) this.position = this.shown;
    this.isPlaying = false;
    this.events.changed();
  }

  /** The key frame of the GoF is seen until the frame itself is decoded. */
  seek(frame: number): void {
    this.position = Math.max(0, Math.min(this.numFrames - 1, Math.floor(frame)));
    this.seeks = true;
    this.aim(true);
    this.events.changed();
    this.check();
  }

  step(count: number): void {
    this.pause();
    this.seek((this.frame + count + this.numFrames) % Math.max(1, this.numFrames));
  }

  /** Changes how it looks. */
  set look(look: Partial<Look>) { if (this.renderer) Object.assign(this.renderer.look, look); this.isDirty = true; }

  /** To be said after the camera was changed. */
  moved(): void {
    this.isDirty = this.needsOrder = true;
    this.events.moved();
  }

  /** The whole of the frame that is seen comes into view. */
  frameAll(): void {
    const frame = this.stream?.get(this.shown);
    if (frame) this.camera.frame(frame.moving, frame.count);
    this.moved();
  }

  private startSorter(): void {
    this.sorter?.terminate();
    this.sorter = startWorker();
    this.sorterHas = undefined;
    this.sorter.onmessage = ({ data }: MessageEvent<Sorted>) => {
      this.statistics.sort = data.ms;
      this.sorting = -1;
      this.sorted = data;
    };
  }

  private receive = (frame: PackedFrame, ms: { decode: number; pack: number }): void => {
    Object.assign(this.statistics, ms);
    if (!this.isFramed && frame.count) {
      this.camera.frame(frame.moving, frame.count);
      this.isFramed = true;
    }
  };

  /** Frames that cannot be decoded say so when their turn comes. */
  private check(): void {
    const error = this.stream?.get(this.frame) ? undefined : this.stream?.errorAt(this.frame);
    if (error) this.fail(error);
  }

  private fail(error: PlayerError): void { this.isPlaying = false; this.events.failed(error); this.events.changed(); }

  private aim(isJump: boolean): void { this.stream?.aim(this.frame, this.isLooping, isJump); }

  private tick = (now: number): void => {
    if (this.ended) return;
    requestAnimationFrame(this.tick);
    const passed = Math.min(now - this.last, LONGEST_TICK);
    this.last = now;
    if (!this.stream) return;
    const before = this.frame;
    if (this.isPlaying && this.shown >= 0 && !this.seeks) this.advance(passed / 1000);
    if (this.frame !== before) this.aim(false);
    this.show();
    this.order(passed);
    if (this.resized() || this.isDirty) this.draw();
    this.count(now);
  };

  /** Time passes; it stands still before frames that are not decoded yet. */
  private advance(seconds: number): void {
    const stream = this.stream!, step = seconds * this.frameRate * this.speed, there = stream.ready(this.frame);
    const most = Math.floor(this.position) + Math.max(there, 1) - 1e-6, wanted = this.position + step;
    const isWaiting = wanted > most && (this.isLooping || most < this.numFrames - 1);
    this.position = Math.min(wanted, most);
    this.events.waiting(isWaiting && !stream.get((this.frame + 1) % this.numFrames));
    if (wanted >= this.numFrames && !this.isLooping) return this.pause();
    if (this.position >= this.numFrames) this.position -= this.numFrames;
    const next = (this.frame + 1) % this.numFrames;
    if (isWaiting && stream.errorAt(next)) this.seek(next);
  }

  /** What was sorted is seen now. */
  private show(): void {
    const { sorted, stream } = this;
    this.sorted = undefined;
    if (!sorted) return;
    const start = performance.now();
    if (sorted.index === this.shown) this.renderer!.setOrder(sorted);
    else {
      const frame = stream!.get(sorted.index);
      if (!frame) return;
      try { this.renderer!.setFrame(frame, sorted); } catch (error) { return this.fail(PlayerError.of(error)); }
      this.shown = sorted.index;
      this.statistics.gaussians = frame.count;
      this.statistics.firstPicture ||= performance.now() - this.started;
      if (this.shown === this.frame) { this.seeks = false; this.events.waiting(false); }
      this.events.changed();
    }
    this.statistics.upload = performance.now() - start;
    this.isDirty = true;
  }

  /** Has sorted what will be seen next: the frame of the next tick, a key frame on the way to another, or this one anew. */
  private order(passed: number): void {
    if (this.sorting >= 0 || !this.sorter) return;
    const ahead = this.isPlaying && !this.seeks ? (passed / 1000) * this.frameRate * this.speed : 0;
    const wanted = Math.floor(this.position + ahead) % this.numFrames, candidates = [wanted, this.frame, this.stream!.keyOf(this.frame)];
    const index = candidates.find((one, i) => this.stream!.get(one) && (i < 2 || this.seeks || this.shown < 0));
    if (index === undefined || (index === this.shown && !this.needsOrder)) return;
    const frame = this.stream!.get(index)!, message: ToSort = { index, camera: this.lens() };
    this.needsOrder = false;
    this.sorting = index;
    this.sorter.postMessage(this.sorterHas === frame ? message : { ...message, count: frame.count, moving: frame.moving });
    this.sorterHas = frame;
  }

  private lens() { return this.camera.lens(this.canvas.width, this.canvas.height); }

  private resized(): boolean {
    const { canvas } = this, density = this.density ?? Math.min(devicePixelRatio || 1, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * density)));
    if (width === canvas.width && height === canvas.height) return false;
    [canvas.width, canvas.height] = [width, height];
    return true;
  }

  private draw(): void {
    if (!this.renderer) return;
    const start = performance.now();
    this.renderer.draw(this.lens());
    this.statistics.draw = performance.now() - start;
    this.isDirty = false;
    this.ticks++;
  }

  private since = 0;
  private bytesBefore = 0;

  /** Once a second: pictures and bytes a second. */
  private count(now: number): void {
    const { statistics, stream } = this, seconds = (now - this.since) / 1000;
    if (seconds < 1) return;
    statistics.pictures = this.ticks / seconds;
    statistics.bytesPerSecond = (stream!.bytesRead - this.bytesBefore) / seconds;
    statistics.ahead = stream!.ready(this.frame);
    [this.since, this.ticks, this.bytesBefore] = [now, 0, stream!.bytesRead];
  }
}
