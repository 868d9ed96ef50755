/** Draws packed frames with WebGL2: a projection pass writes place and colour of every Gaussian once, then quads only read those. */
import type { Lens } from "./camera";
import { PlayerError } from "./errors";
import { ROW, rowsOf, texelsOf, type PackedFrame } from "./pack";
import { CHUNK, FULL_SCREEN, projection, SPLAT_FRAGMENT, SPLAT_VERTEX } from "./shaders";
import type { Order } from "./sort";

export interface Look { shDegree: number; size: number; background: [number, number, number] }

type Name = "moving" | "fixedPart" | "harmonics" | "order" | "place" | "paint";

export class Renderer {
  readonly look: Look = { shDegree: 3, size: 1, background: [0, 0, 0] };
  private readonly projection: WebGLProgram;
  private readonly splats: WebGLProgram;
  private readonly target: WebGLFramebuffer;
  private textures = new Map<Name, WebGLTexture>();
  private rows = 0;
  private count = 0;
  private visible = 0;
  /** ids of the parts that the textures have */
  private parts = { fixed: {} as object, sh: {} as object };

  private constructor(private readonly gl: WebGL2RenderingContext, private readonly degree: number) {
    this.projection = program(gl, FULL_SCREEN, projection(degree));
    this.splats = program(gl, SPLAT_VERTEX, SPLAT_FRAGMENT);
    this.target = gl.createFramebuffer()!;
    const quads = Uint16Array.from({ length: 6 * CHUNK }, (_, i) => 4 * Math.floor(i / 6) + [0, 1, 2, 2, 1, 3][i % 6]);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, quads, gl.STATIC_DRAW);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  /** `degree`: of the SH of the file. */
  static on(gl: WebGL2RenderingContext, degree: number): Renderer { return new Renderer(gl, degree); }

  static context(canvas: HTMLCanvasElement): WebGL2RenderingContext {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, depth: false, powerPreference: "high-performance" });
    if (!gl) throw new PlayerError("browser", "this browser has no WebGL2, which draws the picture (it may be switched off)");
    return gl;
  }

  /** Data and their order: both or neither. */
  setFrame(frame: PackedFrame, order: Order): void {
    const { gl } = this, rows = rowsOf(frame.count);
    if (rows > this.rows) this.allocate(rows);
    this.count = frame.count;
    this.upload("moving", gl.RGBA_INTEGER, gl.UNSIGNED_INT, rows, frame.moving);
    if (this.parts.fixed !== frame.fixed) this.upload("fixedPart", gl.RGBA, gl.FLOAT, rows, frame.fixed.data);
    if (this.parts.sh !== frame.sh) this.upload("harmonics", gl.RGBA_INTEGER, gl.UNSIGNED_INT, rows * texelsOf(this.degree), frame.sh.data);
    this.parts = { fixed: frame.fixed, sh: frame.sh };
    this.setOrder(order);
  }

  setOrder({ order, visible }: Order): void {
    const { gl } = this;
    this.upload("order", gl.RED_INTEGER, gl.UNSIGNED_INT, Math.ceil(visible / ROW), order);
    this.visible = visible;
  }

  draw(lens: Lens): void {
    const { gl, look } = this;
    if (this.count) this.project(lens);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, lens.width, lens.height);
    gl.clearColor(...look.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (!this.visible) return;
    const at = this.use(this.splats, ["order", "place", "paint"]);
    gl.uniform2f(at("picture"), lens.width, lens.height);
    gl.uniform1i(at("visible"), this.visible);
    gl.enable(gl.BLEND);
    gl.drawElementsInstanced(gl.TRIANGLES, 6 * CHUNK, gl.UNSIGNED_SHORT, 0, Math.ceil(this.visible / CHUNK));
    gl.disable(gl.BLEND);
  }

  /** Gives its textures back. */
  free(): void { for (const texture of this.textures.values()) this.gl.deleteTexture(texture); }

  private project({ view: v, focal, near, width, height }: Lens): void {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(0, 0, ROW, rowsOf(this.count));
    const at = this.use(this.projection, ["moving", "fixedPart", "harmonics"]);
    gl.uniformMatrix4fv(at("view"), true, v);
    gl.uniform4f(at("lens"), focal, near, width / 2, height / 2);
    const [x, y, z] = [0, 1, 2].map((j) => -(v[j] * v[3] + v[4 + j] * v[7] + v[8 + j] * v[11]));
    gl.uniform3f(at("eye"), x, y, z);
    gl.uniform1i(at("degree"), this.look.shDegree);
    gl.uniform1i(at("count"), this.count);
    gl.uniform1f(at("size"), this.look.size);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  private use(made: WebGLProgram, names: Name[]): (name: string) => WebGLUniformLocation | null {
    const { gl } = this;
    gl.useProgram(made);
    names.forEach((name, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, this.textures.get(name)!);
      gl.uniform1i(gl.getUniformLocation(made, name), unit);
    });
    return (name) => gl.getUniformLocation(made, name);
  }

  /** Textures for more Gaussians than before. */
  private allocate(rows: number): void {
    const { gl } = this, texels = texelsOf(this.degree), most = gl.getParameter(gl.MAX_TEXTURE_SIZE) as number;
    if (rows * texels > most)
      throw new PlayerError("browser", `this graphics card draws at most ${Math.floor(most / texels) * ROW} Gaussians of this kind`);
    this.free();
    this.rows = rows;
    this.texture("moving", gl.RGBA32UI, rows);
    this.texture("fixedPart", gl.RGBA32F, rows);
    this.texture("harmonics", gl.RGBA32UI, rows * texels);
    this.texture("order", gl.R32UI, rows);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    const outputs = [this.texture("place", gl.RGBA32UI, rows), this.texture("paint", gl.RG32UI, rows)];
    outputs.forEach((texture, i) => gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + i, gl.TEXTURE_2D, texture, 0));
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    this.parts = { fixed: {}, sh: {} };
  }

  private texture(name: Name, format: number, rows: number): WebGLTexture {
    const { gl } = this, made = gl.createTexture()!;
    this.textures.set(name, made);
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, ROW, rows);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
    return made;
  }

  private upload(name: Name, format: number, type: number, rows: number, data: ArrayBufferView): void {
    const { gl } = this;
    if (!rows) return;
    gl.bindTexture(gl.TEXTURE_2D, this.textures.get(name)!);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, ROW, rows, format, type, data);
  }
}

function program(gl: WebGL2RenderingContext, vertex: string, fragment: string): WebGLProgram {
  const made = gl.createProgram()!;
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]] as const) {
    const shader = gl.createShader(kind)!;
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (gl.getProgramParameter(made, gl.LINK_STATUS) || gl.isContextLost()) return made;
  const logs = gl.getAttachedShaders(made)!.map((shader) => gl.getShaderInfoLog(shader)).join(" ");
  throw new PlayerError("browser", `this graphics card refuses a shader: ${logs || gl.getProgramInfoLog(made)}`);
}
