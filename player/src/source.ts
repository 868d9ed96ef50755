/** Where the bytes of a file come from: an address, of which parts are asked for, or a Blob. */
import { PlayerError } from "./errors";

export interface Source {
  readonly size: number;
  /** bytes `start` to `end` - 1; fewer where the file ends */
  read(start: number, end: number): Promise<Uint8Array>;
}

const FIRST = 65536, TRIES = 4, PATIENCE = 250;

/** A server that knows no ranges sends the whole file at once. */
export async function openSource(from: string | Blob): Promise<Source> {
  if (from instanceof Blob) return new BlobSource(from);
  const answer = await persistent(() => part(from, 0, FIRST));
  if (answer.total === undefined) return new BlobSource(new Blob([answer.bytes as BlobPart]));
  return new UrlSource(from, answer.total, answer.bytes);
}

class BlobSource implements Source {
  constructor(private readonly blob: Blob) {}
  get size(): number { return this.blob.size; }
  async read(start: number, end: number): Promise<Uint8Array> {
    return new Uint8Array(await this.blob.slice(start, end).arrayBuffer());
  }
}

class UrlSource implements Source {
  constructor(private readonly url: string, readonly size: number, private readonly head: Uint8Array) {}

  async read(start: number, end: number): Promise<Uint8Array> {
    end = Math.min(end, this.size);
    if (end <= start) return new Uint8Array(0);
    if (end <= this.head.length) return this.head.subarray(start, end);
    return persistent(async () => {
      const { bytes } = await part(this.url, start, end);
      if (bytes.length !== end - start) throw new PlayerError("network", `${bytes.length} of ${end - start} bytes came`);
      return bytes;
    });
  }
}

/** `total` is undefined where the answer is the whole file. */
async function part(url: string, start: number, end: number): Promise<{ bytes: Uint8Array; total?: number }> {
  const answer = await fetch(url, { headers: { range: `bytes=${start}-${end - 1}` } });
  if (answer.status === 416) return { bytes: new Uint8Array(0) };
  if (!answer.ok) throw new PlayerError("network", `the server answers ${answer.status} ${answer.statusText}`);
  const bytes = new Uint8Array(await answer.arrayBuffer());
  if (answer.status !== 206) {
    if (start) throw new PlayerError("network", "the server no longer sends parts of the file");
    return { bytes };
  }
  const total = Number(/\/(\d+)$/.exec(answer.headers.get("content-range") ?? "")?.[1] ?? NaN);
  if (!(total >= 0)) throw new PlayerError("network", "the server does not say how long the file is");
  return { bytes, total };
}

/** Connections that break are tried again, what a server refuses is not. */
async function persistent<T>(attempt: () => Promise<T>): Promise<T> {
  for (let tried = 1; ; tried++) {
    try { return await attempt(); } catch (error) {
      if (error instanceof PlayerError && error.message.startsWith("the server")) throw error;
      if (tried === TRIES) throw new PlayerError("network", `the file cannot be read: ${(error as Error).message}`);
      await new Promise((done) => setTimeout(done, PATIENCE * 2 ** tried));
    }
  }
}
