/** `import { decode } from "dfcgs-player"`, and the element `<dfcgs-player>`. */
import text from "package:assets";
import { assetsOf } from "./assets";
import { framesOf, type Assets, type Frame } from "./decoder";
import { define, DfcgsPlayer, provide } from "./element";
import { PlayerError } from "./errors";

let assets: Promise<Assets> | undefined;
const shared = () => (assets ??= assetsOf(text));

export interface DecodeOptions { start?: number; stop?: number; check?: boolean }

/** Frames of a file, an address or a Blob, one after the other: frames `start` to `stop` - 1. Runs where it is called: in a worker of
 *  yours, nothing else waits for it. `check` false leaves hashes out. */
export async function* decode(from: string | Blob, options: DecodeOptions = {}): AsyncGenerator<Frame> {
  yield* framesOf(from, await shared(), options);
}

provide(shared);
if (typeof customElements !== "undefined") define();

export { DfcgsPlayer, PlayerError };
export type { Frame };
