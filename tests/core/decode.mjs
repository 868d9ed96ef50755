// Decodes files with the C core in Node: `node decode.mjs core.wasm words hash FILE...` prints, as JSON, for each file its status
// and the SHA-256 of the arrays of each frame.
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";

const [wasm, words, modelHash, ...files] = process.argv.slice(2);
const { instance } = await WebAssembly.instantiate(readFileSync(wasm), {});
const core = instance.exports;
const bytesAt = (address, count) => new Uint8Array(core.memory.buffer, address, count);

function put(data) {
  const address = core.core_room(data.length) >>> 0;
  bytesAt(address, data.length).set(data);
  return address;
}

// offsets of exports.c
const info = core.core_info() >>> 0;
const int = (offset) => new DataView(core.memory.buffer).getInt32(info + offset, true);
const COUNT = 56, ARRAYS = 152;

function frameDigest(numRest, wide) {
  const count = int(COUNT), widths = [3 * wide, 4, 3, 1, 3, 3 * numRest], digest = createHash("sha256");
  core.core_output(63);
  widths.forEach((width, i) => digest.update(bytesAt(int(ARRAYS + 4 * i) >>> 0, 4 * width * count)));
  return digest.digest("hex");
}

function decode(data) {
  core.core_reset(0xffffffff);
  const model = readFileSync(words);
  if (core.core_open(put(model), model.length / 4)) throw new Error("the model is refused");
  const hash = put(Buffer.from(modelHash, "hex"));
  const frames = [];
  let status = core.core_file(put(data), data.length, hash);
  while (!status) {
    status = core.core_next();
    if (status || int(COUNT) === -1) break;
    frames.push(frameDigest(core.core_num_rest(), core.core_position_floats()));
  }
  return { status, frames };
}

console.log(JSON.stringify(files.map((file) => decode(readFileSync(file)))));
