// node measure.mjs ASSETS.json FILE.dgs: what a frame costs a worker of the player, in milliseconds of processor time, as JSON.
// The time is that of the whole process in Node, compilation of the decoder in the background included.
import fs from "node:fs";
import os from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const source = path.join(path.dirname(fileURLToPath(import.meta.url)), "src");
const contents = ["assets", "decoder", "pack", "sort"].map((name) => `export * from "./${name}";`).join("\n");
const made = await build({ stdin: { contents, resolveDir: source, loader: "ts" }, bundle: true, format: "esm", write: false });
const player = await import(`data:text/javascript;base64,${Buffer.from(made.outputFiles[0].text).toString("base64")}`);

const [assetsFile, file] = process.argv.slice(2), ALL = 63;
const spent = () => { const { user, system } = process.cpuUsage(); return (user + system) / 1000; };
const rounded = (value) => Math.round(value * 10) / 10;
const lens = { view: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 5, 0, 0, 0, 1], near: 0.01, width: 1, height: 1, focal: 1 };

const assets = await player.assetsOf(JSON.parse(fs.readFileSync(assetsFile, "utf8")));
const decoder = await player.FrameDecoder.open(new Blob([fs.readFileSync(file)]), assets);
const { numFrames, shDegree } = decoder.sequence, keys = decoder.container.gofs.map(({ first }) => first);
const sorter = new player.Sorter(), frames = [];
let arrays = [];
for (let index = 0; index < numFrames; index++) {
  const times = [spent()], lap = () => times.push(spent());
  while (!(await decoder.advance(index)));
  lap();
  const fresh = decoder.output(ALL);
  arrays = fresh.map((array, i) => array?.slice() ?? arrays[i]);
  const moving = player.packMoving(decoder.count, arrays[0], arrays[1], [0, 0, 0]);
  if (fresh[2] || fresh[3]) player.packFixed(decoder.count, arrays[2], arrays[3]);
  if (fresh[4] || fresh[5]?.length) player.packSh(decoder.count, shDegree, arrays[4], arrays[5]);
  lap();
  sorter.sort(moving, decoder.count, lens, new Uint32Array(moving.length / 4));
  lap();
  const [decode, pack, sort] = [0, 1, 2].map((i) => rounded(times[i + 1] - times[i]));
  frames.push({ frame: index, type: keys.includes(index) ? "I" : "P", gaussians: decoder.count, decode, pack, sort });
}
const machine = { processor: os.cpus()[0].model, cores: os.cpus().length, node: process.version };
console.log(JSON.stringify({ file: path.basename(file), sh_degree: shDegree, machine, frames }, null, 1));
