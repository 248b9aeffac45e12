// SPDX-License-Identifier: Apache-2.0
// Reads .gs4d files as they arrive: Gaussians that move along lines, in chunks in the order of
// time. gs_model/formats/gs4d/gs4d.h says what each byte means.

const HEADER = 32,
  ENTRY = 16; // bytes
const VERSION = 1,
  BLOCK_FLOATS = 18;
const MOST_IN_CHUNK = 32768,
  IN_BLOCK = 256; // Gaussians
const ROTATION_UNIT = Math.SQRT1_2 / 511;
const SH_NUMBERS = [0, 9, 24, 45]; // of each SH degree, beyond degree 0
export const MIN_MARGINAL = 0.05; // kMinMarginal of gs_core/math/constants.h

const damaged = what => new Error(`The model's file is damaged: ${what}.`);

// The bytes of a stream, any number at a time.
class Bytes {
  constructor(stream) {
    this.reader = stream.getReader();
    this.parts = [];
    this.held = 0;
  }
  async take(count) {
    while (this.held < count) {
      const {value, done} = await this.reader.read();
      if (done) throw damaged('it ends too early');
      this.parts.push(value);
      this.held += value.byteLength;
    }
    const bytes = new Uint8Array(count);
    for (let at = 0; at < count;) {
      const part = this.parts[0],
        some = Math.min(part.byteLength, count - at);
      bytes.set(part.subarray(0, some), at);
      at += some;
      if (some === part.byteLength) this.parts.shift();
      else this.parts[0] = part.subarray(some);
    }
    this.held -= count;
    return bytes.buffer;
  }
}

/// Reads a file: {header, chunks}. header: {count, shDegree, antialiased, duration, table}, with the
/// table's {count, bytes, begin, end}; chunks: an async iterator of what chunkOf() returns, one for
/// each row of the table.
export async function readGs4d(stream) {
  const bytes = new Bytes(stream);
  const header = headerOf(new DataView(await bytes.take(HEADER)));
  const rows = new DataView(await bytes.take(header.chunks * ENTRY));
  header.table = Array.from({length: header.chunks}, (_, i) => ({
    count: rows.getUint32(ENTRY * i, true),
    bytes: rows.getUint32(ENTRY * i + 4, true),
    begin: rows.getFloat32(ENTRY * i + 8, true),
    end: rows.getFloat32(ENTRY * i + 12, true),
  }));
  for (const {count, bytes} of header.table)
    if (!count || count > MOST_IN_CHUNK || bytes !== arraysOf(count, header).end)
      throw damaged(`a chunk has ${count} Gaussians in ${bytes} bytes`);
  if (header.table.reduce((sum, {count}) => sum + count, 0) !== header.count)
    throw damaged('its table does not match its header');
  async function* chunks() {
    for (const entry of header.table) yield chunkOf(await bytes.take(entry.bytes), entry, header);
  }
  return {header, chunks: chunks()};
}

function headerOf(view) {
  if (view.getUint32(0, false) !== 0x47533444) throw damaged('it does not begin with GS4D');
  const version = view.getUint32(4, true);
  if (version !== VERSION)
    throw new Error(
      `This page reads .gs4d files of version ${VERSION}, and not of version ${version}.`,
    );
  const header = {
    count: view.getUint32(8, true),
    chunks: view.getUint32(12, true),
    shDegree: view.getUint8(16),
    antialiased: (view.getUint8(17) & 1) !== 0,
    duration: view.getFloat32(20, true),
  };
  if (header.shDegree > 3) throw damaged(`its SH degree is ${header.shDegree}`);
  return header;
}

// Where the arrays of a chunk begin.
function arraysOf(count, {shDegree}) {
  const rotations = Math.ceil(count / IN_BLOCK) * BLOCK_FLOATS * 4,
    positions = rotations + 4 * count,
    drifts = positions + 6 * count,
    times = drifts + 6 * count,
    scales = times + 4 * count,
    opacities = scales + 3 * count,
    colors = opacities + count,
    sh = colors + 3 * count;
  return {
    rotations,
    positions,
    drifts,
    times,
    scales,
    opacities,
    colors,
    sh,
    end: sh + SH_NUMBERS[shDegree] * count,
  };
}

// A chunk as plain arrays: mean, velocity, logScale, sh0 (3 numbers each), rotation (4: x y z w),
// timeMean, timeScale, opacity, sh (SH_NUMBERS of them each).
function chunkOf(buffer, {count, begin, end}, header) {
  const {shDegree} = header,
    at = arraysOf(count, header),
    numbers = SH_NUMBERS[shDegree];
  const blocks = new Float32Array(buffer, 0, at.rotations / 4),
    words = new Uint32Array(buffer, at.rotations, count);
  const positions = new Uint16Array(buffer, at.positions, 3 * count),
    drifts = new Int16Array(buffer, at.drifts, 3 * count);
  const times = new Uint16Array(buffer, at.times, 2 * count),
    bytes = new Uint8Array(buffer),
    sh8 = new Int8Array(buffer, at.sh);
  const floats = each => new Float32Array(each * count);
  const chunk = {
    count,
    begin,
    end,
    shDegree,
    mean: floats(3),
    velocity: floats(3),
    logScale: floats(3),
    sh0: floats(3),
    rotation: floats(4),
    timeMean: floats(1),
    timeScale: floats(1),
    opacity: floats(1),
    sh: floats(numbers),
  };
  for (let i = 0; i < count; ++i) {
    const b = Math.floor(i / IN_BLOCK) * BLOCK_FLOATS,
      value = (from, steps) => blocks[b + from] + blocks[b + from + 1] * steps;
    const timeScale = Math.exp(value(11, times[2 * i + 1]));
    chunk.timeMean[i] = value(9, times[2 * i]);
    chunk.timeScale[i] = timeScale;
    chunk.opacity[i] = bytes[at.opacities + i] / 255;
    for (let k = 0; k < 3; ++k) {
      const n = 3 * i + k;
      chunk.mean[n] = blocks[b + k] + blocks[b + 3 + k] * positions[n];
      chunk.velocity[n] = (blocks[b + 6 + k] * drifts[n]) / timeScale;
      chunk.logScale[n] = value(13, bytes[at.scales + n]);
      chunk.sh0[n] = value(15, bytes[at.colors + n]);
    }
    for (let n = numbers * i; n < numbers * (i + 1); ++n) chunk.sh[n] = blocks[b + 17] * sh8[n];
    unpackRotation(words[i], chunk.rotation, 4 * i);
  }
  return chunk;
}

// The quaternion of a word, as x y z w.
function unpackRotation(word, to, at) {
  const largest = word >>> 30;
  let rest = 1;
  for (let k = 0, next = 0; k < 4; ++k) {
    if (k === largest) continue;
    const part = ((word << (22 - 10 * next++)) >> 22) * ROTATION_UNIT; // ten bits with a sign
    rest -= part * part;
    to[at + ((k + 3) % 4)] = part;
  }
  to[at + ((largest + 3) % 4)] = Math.sqrt(Math.max(0, rest));
}
