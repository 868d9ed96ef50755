/** The page of `dfcgs view` and `dfcgs export`: one or two players, cameras and frames locked together. */
import { assetsOf, bytesOf, type AssetsText } from "./assets";
import { define, provide, type DfcgsPlayer } from "./element";
import { PlayerError } from "./errors";

/** `url` is beside the page, `data` in it, as base64 in an element of this id. */
interface Config { files: { name: string; url?: string; data?: string }[]; up: string; view?: { eye: number[]; target: number[] } }

const text = (id: string) => document.getElementById(id)!.textContent!;
const config = JSON.parse(text("config")) as Config;

provide(() => assetsOf(JSON.parse(text("assets")) as AssetsText));
define();

const players = config.files.map(({ name }) => {
  const player = document.createElement("dfcgs-player") as DfcgsPlayer;
  for (const attribute of ["controls", "autoplay", "loop"]) player.toggleAttribute(attribute, true);
  player.setAttribute("up", config.up);
  player.setAttribute("aria-label", name);
  const figure = document.createElement("figure"), caption = document.createElement("figcaption");
  caption.textContent = name;
  caption.hidden = config.files.length < 2;
  figure.append(player, caption);
  document.body.append(figure);
  return player;
});

/** What one does the other does, unless it is the one that was told. */
function lock(players: DfcgsPlayer[]): void {
  let isTold = false;
  const tell = (from: DfcgsPlayer, change: (other: DfcgsPlayer) => void) => {
    if (isTold) return;
    isTold = true;
    players.filter((other) => other !== from && other.player).forEach(change);
    isTold = false;
  };
  for (const player of players) {
    player.addEventListener("camera", () => tell(player, (other) => { other.pose = player.pose; }));
    player.addEventListener("frame", () => tell(player, (other) => {
      const [mine, theirs] = [player.player!, other.player!];
      if (mine.isPlaying !== theirs.isPlaying) { if (mine.isPlaying) theirs.play(); else theirs.pause(); }
      if (Math.abs(mine.frame - theirs.frame) > (mine.isPlaying ? 1 : 0) && theirs.numFrames) theirs.seek(mine.frame);
    }));
  }
}

/** Pages that come from the disk may not read what lies beside them: the user may. */
function choose(player: DfcgsPlayer, name: string): void {
  const field = Object.assign(document.createElement("input"), { type: "file", accept: ".dgs" });
  field.onchange = () => { if (field.files?.[0]) void player.open(field.files[0]); };
  const why = "A page that is opened from the disk may not read the files beside it. Choose it yourself, or serve the folder.";
  player.say(new PlayerError("network", `${name}: ${why}`), { label: "Choose the file", run: () => field.click() });
}

function start(player: DfcgsPlayer, { name, url, data }: Config["files"][number]): void {
  if (!player.player) return;
  if (data) void player.open(new Blob([bytesOf(text(data)) as BlobPart]));
  else if (location.protocol === "file:") choose(player, name);
  else void player.open(url!);
}

const { view } = config;
if (view && players[0].player) {
  players[0].player.camera.lookAt(view.eye as [number, number, number], view.target as [number, number, number]);
  players[0].pose = players[0].pose;
}
if (players.length > 1) lock(players);
players.forEach((player, i) => start(player, config.files[i]));

document.addEventListener("dragover", (event) => event.preventDefault());
document.addEventListener("drop", (event) => {
  event.preventDefault();
  const file = event.dataTransfer?.files[0], place = players.find((player) => event.composedPath().includes(player)) ?? players[0];
  if (file) void place.open(file);
});
