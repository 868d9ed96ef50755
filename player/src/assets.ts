/** Core and models as they stand in pages: base64. */
import type { Assets } from "./decoder";
import { PlayerError } from "./errors";

export interface AssetsText { core: string; models: { id: string; hash: string; words: string }[] }

export function bytesOf(text: string): Uint8Array {
  return Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
}

export async function assetsOf(text: AssetsText): Promise<Assets> {
  if (typeof WebAssembly !== "object") throw new PlayerError("browser", "this browser has no WebAssembly, which decodes the file");
  let module: WebAssembly.Module;
  try {
    module = await WebAssembly.compile(bytesOf(text.core) as BufferSource);
  } catch (error) {
    throw new PlayerError("browser", `this browser cannot run the decoder (WebAssembly with SIMD): ${(error as Error).message}`);
  }
  return { module, models: text.models.map(({ id, hash, words }) => ({ id, hash, words: bytesOf(words) })) };
}
