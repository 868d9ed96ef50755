/** Mouse, touch and keys that move the camera. */
import type { OrbitCamera } from "./camera";

const TURN = 0.006, WHEEL = 0.0015, FLIGHT = 0.8, LONGEST_STEP = 0.1;
/** keys of flight: right, down, forward */
const FLIGHTS: Record<string, [number, number, number]> = {
  w: [0, 0, 1], s: [0, 0, -1], a: [-1, 0, 0], d: [1, 0, 0], q: [0, 1, 0], e: [0, -1, 0],
};

interface Point { x: number; y: number }

/** `moved` is called after each change. */
export function listen(canvas: HTMLCanvasElement, camera: OrbitCamera, moved: () => void): void {
  const pointers = new Map<number, Point>();
  const share = () => (2 * Math.tan(camera.pose.fov / 2)) / Math.min(canvas.clientWidth, canvas.clientHeight);
  const pan = (dx: number, dy: number) => camera.move(-dx * share(), -dy * share());
  canvas.addEventListener("pointerdown", (event) => {
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    canvas.setPointerCapture(event.pointerId);
  });
  for (const name of ["pointerup", "pointercancel"] as const) canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const from = pointers.get(event.pointerId), to = { x: event.clientX, y: event.clientY };
    if (!from) return;
    const dx = to.x - from.x, dy = to.y - from.y;
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)![1], apart = (p: Point) => Math.hypot(p.x - other.x, p.y - other.y) || 1;
      camera.zoom(apart(from) / apart(to));
      pan(dx / 2, dy / 2);
    } else if (event.buttons & 2 || event.shiftKey) pan(dx, dy);
    else if (event.altKey) camera.turn(-dx * TURN, -dy * TURN);
    else camera.orbit(dx * TURN, dy * TURN);
    pointers.set(event.pointerId, to);
    moved();
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.zoom(Math.exp(Math.max(-200, Math.min(200, event.deltaY)) * WHEEL));
    moved();
  }, { passive: false });
  flight(canvas, camera, moved);
}

/** As long as keys are down. */
function flight(canvas: HTMLCanvasElement, camera: OrbitCamera, moved: () => void): void {
  const down = new Set<string>();
  let last = 0;
  const fly = (now: number) => {
    if (!down.size) return;
    const step = Math.min((now - last) / 1000, LONGEST_STEP) * FLIGHT;
    last = now;
    for (const key of down) camera.move(...(FLIGHTS[key].map((one) => one * step) as [number, number, number]));
    moved();
    requestAnimationFrame(fly);
  };
  canvas.addEventListener("keydown", (event) => {
    const key = event.key.toLowerCase();
    if (!(key in FLIGHTS) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (!down.size) { last = performance.now(); requestAnimationFrame(fly); }
    down.add(key);
  });
  canvas.addEventListener("keyup", (event) => down.delete(event.key.toLowerCase()));
  canvas.addEventListener("blur", () => down.clear());
}
