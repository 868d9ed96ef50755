/** `<dfcgs-player src="scene.dgs" controls autoplay loop up="-y">` */
import type { Assets } from "./decoder";
import { UP_AXES, type Pose, type UpAxis } from "./camera";
import { listen } from "./controls";
import { PlayerError } from "./errors";
import { Player } from "./player";
import { ICONS, STYLE } from "./style";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4], REFRESH = 500;
const HELP = "Drag to turn, right button or two fingers to move, wheel or pinch to zoom, W A S D Q E to fly";

const icon = (name: keyof typeof ICONS) => `<svg viewBox="0 0 24 24" aria-hidden="true"><path d="${ICONS[name]}"/></svg>`;
const button = (id: string, name: keyof typeof ICONS, label: string, more = "") =>
  `<button id="${id}" type="button" aria-label="${label}" title="${label}" ${more}>${icon(name)}</button>`;
const options = (values: (string | number)[], chosen: string | number, suffix = "") =>
  values.map((value) => `<option value="${value}"${value === chosen ? " selected" : ""}>${value}${suffix}</option>`).join("");

const INSIDE = `<style>${STYLE}</style>
<canvas tabindex="0" role="application" aria-label="The scene in 3D. ${HELP}"></canvas>
<pre class="numbers" hidden aria-label="Measured"></pre>
<div class="wait" role="status" hidden>loading</div>
<div class="note" role="alert" hidden></div>
<div class="panel" id="panel" role="group" aria-label="Settings" hidden>
<label for="speed">Speed</label><select id="speed">${options(SPEEDS, 1, "x")}</select>
<label for="up">Upwards</label><select id="up">${options(UP_AXES, "-y")}</select>
<label for="degree">Colours (SH degree)</label><select id="degree"></select>
<label for="size">Size of Gaussians</label><input id="size" type="range" min="0.05" max="1" step="0.05" value="1">
<label for="numbers">Statistics</label><input id="numbers" type="checkbox">
</div>
<div class="bar" role="group" aria-label="Controls">
${button("play", "play", "Play")}${button("back", "back", "Frame back")}${button("next", "next", "Frame on")}
<input id="scrub" type="range" min="0" max="0" value="0" step="1" aria-label="Frame">
<span class="time" id="time"></span>
${button("loop", "loop", "Loop", 'aria-pressed="true"')}${button("view", "view", "See all of it")}
${button("more", "more", "Settings", 'aria-expanded="false" aria-controls="panel"')}${button("full", "full", "Full screen")}
</div>`;

let assetsOfPage: (() => Promise<Assets>) | undefined;
let assets: Promise<Assets> | undefined;

/** Says where core and models come from; players share them. */
export function provide(from: () => Promise<Assets>): void { assetsOfPage = from; }
const sharedAssets = () => (assets ??= assetsOfPage!());

// where there is no document, as in Node, only `decode` is of use
const Base = (globalThis.HTMLElement ?? Object) as typeof HTMLElement;

export class DfcgsPlayer extends Base {
  static readonly observedAttributes = ["src", "controls", "loop", "up"];
  player?: Player;
  private readonly root = this.attachShadow({ mode: "open" });
  private timer = 0;

  connectedCallback(): void {
    if (this.player) return;
    this.root.innerHTML = INSIDE;
    try {
      this.player = new Player(this.find("canvas"), sharedAssets(), {
        opened: () => this.opened(), changed: () => this.changed(), moved: () => this.tell("camera"),
        waiting: (is) => this.wait(is), failed: (error) => this.say(error),
      });
    } catch (error) {
      this.find(".bar").hidden = true;
      return this.say(PlayerError.of(error));
    }
    this.wire(this.player);
    for (const name of DfcgsPlayer.observedAttributes) this.attributeChangedCallback(name, null, this.getAttribute(name));
  }

  disconnectedCallback(): void {
    clearInterval(this.timer);
    this.player?.close();
    this.player = undefined;
  }

  attributeChangedCallback(name: string, _: string | null, value: string | null): void {
    if (!this.player) return;
    if (name === "src" && value) void this.open(value);
    if (name === "controls") this.find(".bar").hidden = value === null;
    if (name === "loop") this.loop(value !== null);
    if (name === "up" && UP_AXES.includes(value as UpAxis)) this.turnUp(value as UpAxis);
  }

  /** Opens an address or a file. */
  async open(from: string | Blob): Promise<void> {
    this.find(".note").hidden = true;
    this.find(".wait").hidden = false;
    await this.player?.open(from);
    this.find(".wait").hidden = !this.player || this.player.shown >= 0 || !this.player.numFrames;
  }

  get pose(): Pose { return this.player!.camera.pose; }
  /** Puts the camera there, as that of another player. */
  set pose(pose: Pose) {
    this.player!.camera.pose = { ...pose };
    this.player!.isPosed = true;
    this.player!.moved();
  }

  /** Shows what is wrong, with its code, and something that can be done. */
  say(error: PlayerError, action?: { label: string; run: () => void }): void {
    const note = this.find(".note"), code = document.createElement("code");
    code.textContent = error.code;
    note.replaceChildren(`${error.message} `, code);
    if (action) {
      const made = Object.assign(document.createElement("button"), { type: "button", textContent: action.label, onclick: action.run });
      note.append(document.createElement("br"), made);
    }
    note.hidden = false;
    this.find(".wait").hidden = true;
    this.dispatchEvent(new CustomEvent("failure", { detail: error }));
  }

  /** What was wrong is of the past where nothing is waited for. */
  private wait(is: boolean): void {
    this.find(".wait").hidden = !is;
    if (!is) this.find(".note").hidden = true;
  }

  private find<T extends HTMLElement = HTMLElement>(selector: string): T { return this.root.querySelector<T>(selector)!; }
  private tell(name: string): void { this.dispatchEvent(new Event(name)); }

  private opened(): void {
    const player = this.player!, degree = player.shDegree, scrub = this.find<HTMLInputElement>("#scrub");
    scrub.max = String(player.numFrames - 1);
    this.find("#degree").innerHTML = options(Array.from({ length: degree + 1 }, (_, i) => i), degree);
    for (const id of ["play", "back", "next", "scrub", "loop"]) this.find(`#${id}`).toggleAttribute("disabled", player.numFrames < 2);
    this.tell("opened");
    if (this.hasAttribute("autoplay") && player.numFrames > 1) player.play();
  }

  private changed(): void {
    const player = this.player!, play = this.find("#play"), label = player.isPlaying ? "Pause" : "Play", frame = player.frame;
    if (play.getAttribute("aria-label") !== label) {
      play.innerHTML = icon(player.isPlaying ? "pause" : "play");
      play.setAttribute("aria-label", label);
      play.title = label;
    }
    const scrub = this.find<HTMLInputElement>("#scrub"), text = `${frame + 1} / ${player.numFrames}`;
    scrub.value = String(frame);
    scrub.setAttribute("aria-valuetext", `frame ${frame + 1} of ${player.numFrames}`);
    this.find("#time").textContent = text;
    this.tell("frame");
  }

  private wire(player: Player): void {
    const on = (id: string, run: () => void) => this.find(`#${id}`).addEventListener("click", run);
    on("play", () => (player.isPlaying ? player.pause() : player.play()));
    on("back", () => player.step(-1));
    on("next", () => player.step(1));
    on("loop", () => this.toggleAttribute("loop"));
    on("view", () => player.frameAll());
    on("full", () => void this.fullScreen());
    on("more", () => this.unfold());
    const scrub = this.find<HTMLInputElement>("#scrub");
    scrub.addEventListener("input", () => { player.isPlaying = false; player.seek(Number(scrub.value)); });
    this.choose("speed", (value) => { player.speed = Number(value); });
    this.choose("up", (value) => this.setAttribute("up", value));
    this.choose("degree", (value) => { player.look = { shDegree: Number(value) }; });
    this.choose("size", (value) => { player.look = { size: Number(value) }; });
    this.find("#numbers").addEventListener("change", () => this.showNumbers());
    listen(this.find("canvas"), player.camera, () => { player.isPosed = true; player.moved(); });
    this.root.addEventListener("keydown", (event) => this.key(event as KeyboardEvent));
  }

  private choose(id: string, run: (value: string) => void): void {
    const field = this.find<HTMLSelectElement | HTMLInputElement>(`#${id}`);
    field.addEventListener("input", () => run(field.value));
  }

  private key(event: KeyboardEvent): void {
    const player = this.player!, target = event.target as HTMLElement, press = (id: string) => () => this.find(`#${id}`).click();
    if (event.ctrlKey || event.metaKey || event.altKey || target instanceof HTMLSelectElement) return;
    // buttons have a meaning of their own for the space bar, sliders for arrows
    const isButton = target instanceof HTMLButtonElement, isField = target instanceof HTMLInputElement;
    const keys: Record<string, (() => void) | undefined> = {
      " ": isButton ? undefined : press("play"), ArrowLeft: isField ? undefined : press("back"), ArrowRight: isField ? undefined : press("next"),
      Home: () => player.seek(0), End: () => player.seek(player.numFrames - 1), l: press("loop"), f: press("full"), r: press("view"),
      u: () => this.setAttribute("up", UP_AXES[(UP_AXES.indexOf(this.pose.up) + 1) % UP_AXES.length]), i: press("numbers"),
      "+": () => { player.camera.zoom(0.9); player.moved(); }, "-": () => { player.camera.zoom(1 / 0.9); player.moved(); },
      "[": () => this.faster(-1), "]": () => this.faster(1), Escape: () => this.unfold(false),
    };
    const run = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!run) return;
    event.preventDefault();
    run();
  }

  private faster(by: number): void {
    const speed = this.find<HTMLSelectElement>("#speed");
    speed.selectedIndex = Math.max(0, Math.min(SPEEDS.length - 1, speed.selectedIndex + by));
    this.player!.speed = Number(speed.value);
  }

  private loop(is: boolean): void {
    this.player!.isLooping = is;
    this.find("#loop").setAttribute("aria-pressed", String(is));
  }

  private turnUp(up: UpAxis): void {
    this.find<HTMLSelectElement>("#up").value = up;
    this.player!.camera.pose.up = up;
    this.player!.moved();
  }

  private unfold(is = this.find("#panel").hidden): void {
    this.find("#panel").hidden = !is;
    this.find("#more").setAttribute("aria-expanded", String(is));
    if (is) this.find("#speed").focus(); else if (this.root.activeElement !== this.find("canvas")) this.find("#more").focus();
  }

  private async fullScreen(): Promise<void> {
    if (document.fullscreenElement) await document.exitFullscreen();
    else await this.requestFullscreen?.();
  }

  private showNumbers(): void {
    const box = this.find(".numbers"), is = this.find<HTMLInputElement>("#numbers").checked;
    box.hidden = !is;
    clearInterval(this.timer);
    if (is) this.timer = window.setInterval(() => { box.textContent = this.numbers(); }, REFRESH);
  }

  private numbers(): string {
    const s = this.player!.statistics, ms = (value: number) => `${value.toFixed(1)} ms`;
    const rows: [string, string][] = [
      ["Gaussians", String(s.gaussians)], ["decode", ms(s.decode)], ["pack", ms(s.pack)], ["sort", ms(s.sort)], ["upload", ms(s.upload)],
      ["draw", ms(s.draw)], ["pictures", `${s.pictures.toFixed(1)} / s`], ["ahead", `${s.ahead} frames`],
      ["read", `${(s.bytesPerSecond / 1000).toFixed(0)} kB / s`], ["first picture", `${s.firstPicture.toFixed(0)} ms`],
    ];
    return rows.map(([name, value]) => `${name.padEnd(14)}${value}`).join("\n");
  }
}

export const define = (): void => { if (!customElements.get("dfcgs-player")) customElements.define("dfcgs-player", DfcgsPlayer); };
