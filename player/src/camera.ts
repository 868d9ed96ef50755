/** The viewer's camera: turns around a point, with an axis that stays upright. */

/** What the renderer needs. `view`: world to camera (4 x 4), row by row; x right, y down, z forward. `focal`: pixels. */
export interface Lens { view: number[]; width: number; height: number; focal: number; near: number }

export type Triple = [number, number, number];
export type UpAxis = "+x" | "-x" | "+y" | "-y" | "+z" | "-z";
export const UP_AXES: UpAxis[] = ["-y", "+y", "+z", "-z", "+x", "-x"];

const dot = (a: Triple, b: Triple) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a: Triple, b: Triple): Triple => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const plus = (a: Triple, b: Triple, s = 1): Triple => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const scaled = (a: Triple, s: number): Triple => [a[0] * s, a[1] * s, a[2] * s];
const unit = (a: Triple): Triple => scaled(a, 1 / Math.hypot(...a));

export const axisOf = (up: UpAxis): Triple => {
  const sign = up[0] === "-" ? -1 : 1;
  return "xyz".split("").map((name) => (name === up[1] ? sign : 0)) as Triple;
};

const STEEPEST = 1.55, NEAR = 0.01;

/** All of a camera that two players share. Angles in radians, `fov` the vertical one. */
export interface Pose { target: Triple; distance: number; azimuth: number; elevation: number; up: UpAxis; fov: number }

export class OrbitCamera {
  pose: Pose = { target: [0, 0, 0], distance: 3, azimuth: 0, elevation: 0.2, up: "-y", fov: (50 * Math.PI) / 180 };

  /** Directions of azimuth 0 and a quarter turn on. */
  private level(): [Triple, Triple, Triple] {
    const up = axisOf(this.pose.up), first: Triple = up[2] ? [0, -1, 0] : [0, 0, up[1] ? 1 : -1];
    return [first, cross(up, first), up];
  }

  /** From the eye to the target. */
  private get forward(): Triple {
    const { azimuth, elevation } = this.pose, [first, second, up] = this.level(), c = Math.cos(elevation);
    const back = plus(plus(scaled(first, Math.cos(azimuth) * c), second, Math.sin(azimuth) * c), up, Math.sin(elevation));
    return scaled(back, -1);
  }

  get eye(): Triple { return plus(this.pose.target, this.forward, -this.pose.distance); }

  lens(width: number, height: number): Lens {
    const { up, fov, distance } = this.pose, z = this.forward, x = unit(cross(z, axisOf(up))), y = cross(z, x), eye = this.eye;
    const row = (v: Triple) => [...v, -dot(v, eye)];
    // a portrait screen sees as much across as a square one does
    const focal = (0.5 * Math.min(width, height)) / Math.tan(fov / 2);
    return { view: [...row(x), ...row(y), ...row(z), 0, 0, 0, 1], width, height, focal, near: Math.min(NEAR, distance / 100) };
  }

  /** Stands at `eye` and looks at `target`. */
  lookAt(eye: Triple, target: Triple): void {
    const back = plus(eye, target, -1), distance = Math.hypot(...back), [first, second, up] = this.level();
    const d = scaled(back, 1 / distance), elevation = Math.asin(Math.max(-1, Math.min(1, dot(d, up))));
    this.pose = { ...this.pose, target, distance, azimuth: Math.atan2(dot(d, second), dot(d, first)), elevation };
  }

  orbit(across: number, upwards: number): void {
    const { pose } = this;
    pose.azimuth -= across;
    pose.elevation = Math.max(-STEEPEST, Math.min(STEEPEST, pose.elevation + upwards));
  }

  /** Turns the head: the eye stays. */
  turn(across: number, upwards: number): void {
    const eye = this.eye;
    this.orbit(across, upwards);
    this.pose.target = plus(eye, this.forward, this.pose.distance);
  }

  /** In shares of the distance: to the right, down, forward. */
  move(right: number, down: number, forward = 0): void {
    const { pose } = this, [x, y, z] = this.axes();
    pose.target = plus(plus(plus(pose.target, x, right * pose.distance), y, down * pose.distance), z, forward * pose.distance);
  }

  zoom(factor: number): void { this.pose.distance = Math.max(1e-9, this.pose.distance * factor); }

  private axes(): [Triple, Triple, Triple] {
    const z = this.forward, x = unit(cross(z, axisOf(this.pose.up)));
    return [x, cross(z, x), z];
  }

  /** Sees the middle of the Gaussians: their central 96 % along each axis fill the picture. */
  frame(moving: Uint32Array, count: number): void {
    const floats = new Float32Array(moving.buffer, moving.byteOffset, count * 4), step = Math.max(1, Math.floor(count / 20000));
    const low: number[] = [], high: number[] = [];
    for (let axis = 0; axis < 3; axis++) {
      const values: number[] = [];
      for (let i = 0; i < count; i += step) if (Number.isFinite(floats[4 * i + axis])) values.push(floats[4 * i + axis]);
      values.sort((a, b) => a - b);
      low.push(values[Math.floor(values.length * 0.02)] ?? 0);
      high.push(values[Math.floor(values.length * 0.98)] ?? 0);
    }
    const size = Math.hypot(...high.map((value, i) => value - low[i])) || 1;
    this.pose.target = high.map((value, i) => (value + low[i]) / 2) as Triple;
    this.pose.distance = (0.55 * size) / Math.tan(this.pose.fov / 2);
  }
}
