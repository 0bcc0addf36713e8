/* A dump of the flight recorder, as `litegripctl dump` writes it: an MCAP file (https://mcap.dev/spec)
   with chunks that zstd has compressed, and JSON in each message. */

import { decompress } from "./vendor/fzstd.js";

const MAGIC = [0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a];
const CHANNEL = 0x04, MESSAGE = 0x05, CHUNK = 0x06, FOOTER = 0x02;
const MOST_UNPACKED_BYTES = 512 * 1024 * 1024;
const PROGRESS_EVERY_BYTES = 256 * 1024;
const text = new TextDecoder();

class Reader {
  constructor(bytes) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.at = 0;
  }
  u16() { this.at += 2; return this.view.getUint16(this.at - 2, true); }
  u32() { this.at += 4; return this.view.getUint32(this.at - 4, true); }
  u64() { this.at += 8; return Number(this.view.getBigUint64(this.at - 8, true)); }
  take(length) {
    if (this.at + length > this.bytes.length) throw new Error("the file ends too early");
    this.at += length;
    return this.bytes.subarray(this.at - length, this.at);
  }
  text() { return text.decode(this.take(this.u32())); }
}

function* records(bytes) {
  const reader = new Reader(bytes);
  while (reader.at < bytes.length) {
    const kind = reader.take(1)[0];
    yield [kind, reader.take(reader.u64())];
    if (kind === FOOTER) return;
  }
}

function unpacked(content) {
  const reader = new Reader(content);
  reader.take(16); // from when to when
  const size = reader.u64();
  reader.take(4); // its checksum
  const compression = reader.text();
  const packed = reader.take(reader.u64());
  if (compression === "") return packed;
  if (size > MOST_UNPACKED_BYTES) throw new Error(`a piece of it says that it has ${size} bytes`);
  if (compression !== "zstd") throw new Error(`its compression is ${compression}, not zstd`);
  return decompress(packed, new Uint8Array(size));
}

/* Return a tick or an event of a dump; throws Error for what is neither. */
function checked(topic, content) {
  const found = JSON.parse(content);
  const isObject = typeof found === "object" && found !== null && !Array.isArray(found);
  const isRight = isObject && (topic === "tick" ? Object.values(found).every(isPlain) : typeof found.message === "string");
  if (!isRight) throw new Error(`one of its messages is no ${topic}`);
  return found;
}

const isPlain = (value) => value === null || typeof value !== "object" || Array.isArray(value);

/* Return {ticks, events}, each with `time` (Unix, s); throws Error for what is no dump.

   `onProgress` gets how much has been read, 0 to 1. */
export function readDump(bytes, onProgress = () => {}) {
  if (!MAGIC.every((byte, index) => bytes[index] === byte)) throw new Error("it is no MCAP file");
  const topics = new Map();
  const found = { ticks: [], events: [] };
  const take = (kind, content) => {
    const reader = new Reader(content);
    if (kind === CHUNK) {
      for (const record of records(unpacked(content))) take(...record);
    } else if (kind === CHANNEL) {
      const id = reader.u16();
      reader.u16(); // its schema
      topics.set(id, reader.text().split("/").at(-1));
    } else if (kind === MESSAGE) {
      const topic = topics.get(reader.u16());
      reader.u32(); // its number
      const time = reader.u64() / 1e9;
      reader.u64(); // when it was published
      const list = { tick: found.ticks, event: found.events }[topic];
      list?.push({ ...checked(topic, text.decode(content.subarray(reader.at))), time });
    }
  };
  let told = 0;
  for (const [kind, content] of records(bytes.subarray(MAGIC.length))) {
    take(kind, content);
    const at = content.byteOffset + content.byteLength;
    if (at - told < PROGRESS_EVERY_BYTES) continue;
    told = at;
    onProgress(at / bytes.length);
  }
  if (found.ticks.length === 0) throw new Error("it holds no ticks of a LiteGrip");
  return found;
}
