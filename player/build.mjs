// node build.mjs            the player of the Python package: ../src/dfcgs_codec/player/player.js
// node build.mjs check      fails where that is another
// node build.mjs package    the npm package: dist/index.js, with the core and the models in it
import { createHash } from "node:crypto";
import fs from "node:fs";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = path.dirname(fileURLToPath(import.meta.url));
const target = path.join(here, "..", "src", "dfcgs_codec", "player", "player.js");
const common = {
  bundle: true, minify: true, target: "es2022", charset: "utf8", legalComments: "none", write: false, logLevel: "warning",
};

/** SHA-256 of all that the build is made of; tests/unit/test_player_build.py computes the same */
function digest() {
  const hash = createHash("sha256");
  const sources = fs.readdirSync(path.join(here, "src")).sort().map((name) => `src/${name}`);
  for (const name of ["build.mjs", "package-lock.json", "package.json", ...sources])
    hash.update(`${name}\n`).update(fs.readFileSync(path.join(here, name)));
  return hash.digest("hex");
}

const text = async (options) => (await build({ ...common, ...options })).outputFiles[0].text;
const source = (name) => path.join(here, "src", name);
const worker = await text({ entryPoints: [source("worker.ts")], format: "iife" });

/** `import code from "worker:code"` is the text of the worker */
const workers = {
  name: "workers",
  setup(made) {
    made.onResolve({ filter: /^worker:/ }, ({ path: name }) => ({ path: name, namespace: "worker" }));
    made.onLoad({ filter: /.*/, namespace: "worker" }, () => ({ contents: worker, loader: "text" }));
  },
};

/** `import assets from "package:assets"`: core and models as base64 */
const assets = {
  name: "assets",
  setup(made) {
    made.onResolve({ filter: /^package:/ }, ({ path: name }) => ({ path: name, namespace: "package" }));
    made.onLoad({ filter: /.*/, namespace: "package" }, () => ({
      contents: fs.readFileSync(path.join(here, "dist", "assets.json"), "utf8"), loader: "json",
    }));
  },
};

if (process.argv[2] === "package") {
  const made = await text({ entryPoints: [source("index.ts")], format: "esm", plugins: [workers, assets] });
  fs.writeFileSync(path.join(here, "dist", "index.js"), made);
} else {
  const made = await text({ entryPoints: [source("page.ts")], format: "iife", plugins: [workers] });
  // an inline script ends at the first such text
  const script = `// sources: ${digest()}\n${made.replaceAll("</script", "<\\/script")}`;
  if (process.argv[2] !== "check") fs.writeFileSync(target, script);
  else if (fs.readFileSync(target, "utf8") !== script) throw new Error("the package has another build: run `make player`");
}
