/** Fields of the bitstream (chapter 2 of bitstream_spec.md) and the checksum of chunks. */
import { PlayerError, type Code } from "./errors";

export class Reader {
  private at = 0;
  private readonly view: DataView;

  /** `offset`: of the first byte in the file; `short`: the code of an error where bytes are missing */
  constructor(private readonly bytes: Uint8Array, private readonly offset: number, private readonly short: Code = "corrupt") {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  }

  get position(): number { return this.offset + this.at; }
  get left(): number { return this.bytes.length - this.at; }

  u8(): number { return this.raw(1)[0]; }

  raw(count: number): Uint8Array {
    if (count > this.left) throw new PlayerError(this.short, "a field needs more bytes than there are", this.position);
    this.at += count;
    return this.bytes.subarray(this.at - count, this.at);
  }

  u64(): number { this.raw(8); return Number(this.view.getBigUint64(this.at - 8, true)); }

  /** Values from 2**53 on come out rounded: no field that is used here is as large. */
  uvarint(): number {
    const start = this.position;
    let value = 0;
    for (let scale = 1, count = 0; count < 10; count++, scale *= 128) {
      const byte = this.u8();
      value += (byte & 127) * scale;
      if (byte < 128) return value;
    }
    throw new PlayerError("corrupt", "an integer of more than 10 bytes", start);
  }
}

const CRC = Uint32Array.from({ length: 256 }, (_, i) => {
  for (let k = 0; k < 8; k++) i = (i >>> 1) ^ (0xedb88320 & -(i & 1));
  return i >>> 0;
});

export function crc32(bytes: Uint8Array): number {
  let crc = -1;
  for (let i = 0; i < bytes.length; i++) crc = (crc >>> 8) ^ CRC[(crc ^ bytes[i]) & 255];
  return ~crc >>> 0;
}
