// SPDX-License-Identifier: Apache-2.0
// Compares our exports with the readers of other programs. node check.mjs PROGRAM FOLDER
//   1. A random model is exported to every format. splat-transform reads each file but .glb;
//      the result is compared with the model, and with what gemsplat reads from the file.
//   2. gemsplat reads the files that splat-transform writes of the same model.
//   3. The .glb is parsed as glTF 2.0 and KHR_gaussian_splatting specify, compared with the model and
//      with the .glb of splat-transform, and given to gltf-validator.
import {execFileSync} from 'node:child_process';
import {createRequire} from 'node:module';
import {mkdirSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';

const [program, folder] = process.argv.slice(2);
const require = createRequire(import.meta.url);
const packages = process.env.GS_NODE_MODULES;
const transformCli = join(packages, '@playcanvas/splat-transform/bin/cli.mjs');
const kCount = 1000, kRest = 45, kRestPerChannel = 15;
let failures = 0;

function check(isTrue, what) {
  if (!isTrue) ++failures;
  if (!isTrue) console.log(`FAILED: ${what}`);
}
const file = name => join(folder, name);
const quiet = {stdio: ['ignore', 'ignore', 'inherit']};
const ours = (...words) => execFileSync(program, ['export', ...words, '-q', '--no-measure', '--force'], quiet);
const theirs = (...words) =>
    execFileSync(process.execPath, [transformCli, '-w', '-q', '-g', 'cpu', ...words], {stdio: ['ignore', 'ignore', 'ignore']});

// --- the model: positions on a jittered grid, so that rows can be found again by where they are

let state = 12345;
function uniform() {  // Lehmer's generator
  state = state * 48271 % 2147483647;
  return state / 2147483647;
}
const between = (low, high) => Math.fround(low + (high - low) * uniform());
const names = ['x', 'y', 'z', 'f_dc_0', 'f_dc_1', 'f_dc_2', ...Array.from({length: kRest}, (_, i) => `f_rest_${i}`),
               'opacity', 'scale_0', 'scale_1', 'scale_2', 'rot_0', 'rot_1', 'rot_2', 'rot_3'];

function randomRow(i) {
  const cell = [i % 10, Math.floor(i / 10) % 10, Math.floor(i / 100)];
  const q = Array.from({length: 4}, () => between(-1, 1));
  const length = Math.hypot(...q);
  return [...cell.map(c => Math.fround(c - 4 + between(-0.3, 0.3))), ...Array.from({length: 3}, () => between(-1.7, 1.7)),
          ...Array.from({length: kRest}, () => between(-0.5, 0.5)), between(-5, 5),
          ...Array.from({length: 3}, () => between(-7, 1)), ...q.map(v => Math.fround(v / length))];
}

function writePly(path, rows) {
  const header = `ply\nformat binary_little_endian 1.0\nelement vertex ${rows.length}\n` +
      names.map(name => `property float ${name}\n`).join('') + 'end_header\n';
  writeFileSync(path, Buffer.concat([Buffer.from(header), Buffer.from(Float32Array.from(rows.flat()).buffer)]));
}

// Of the columns of writePly(), in the same order.
function readPly(path) {
  const bytes = readFileSync(path), end = bytes.indexOf('end_header\n') + 11;
  const properties = [...bytes.toString('latin1', 0, end).matchAll(/^property float (\w+)$/gm)].map(([, name]) => name);
  const values = new Float32Array(Uint8Array.prototype.slice.call(bytes, end).buffer), columns = names.map(name => properties.indexOf(name));
  return Array.from({length: values.length / properties.length}, (_, i) => columns.map(c => c < 0 ? undefined : values[i * properties.length + c]));
}

function readCsv(path) {
  const [head, ...lines] = readFileSync(path, 'utf8').trim().split('\n').map(line => line.split(','));
  const columns = names.map(name => head.indexOf(name));
  return lines.map(words => columns.map(c => c < 0 ? undefined : Math.fround(words[c])));
}

// --- differences, by kind of number

const at = Object.fromEntries(names.map((name, i) => [name, i]));
const cellOf = row => [0, 1, 2].map(k => Math.round(row[k] + 4)).reduce((sum, c, k) => sum + c * 10 ** k, 0);
const sigmoid = x => 1 / (1 + Math.exp(-x));

function largestDifferences(rows, reference, hasRest) {
  const result = {position: 0, sh0: 0, shRest: 0, opacity: 0, scale: 0, angle: 0};
  const note = (kind, value) => { if (!(value <= result[kind])) result[kind] = Number.isNaN(value) ? Infinity : value; };
  for (const row of rows) {
    const r = reference.get(cellOf(row));
    if (!r) return {missing: cellOf(row)};
    for (let k = 0; k < 3; ++k) {
      note('position', Math.abs(row[k] - r[k]));
      note('sh0', Math.abs(row[at.f_dc_0 + k] - r[at.f_dc_0 + k]));
      note('scale', Math.abs(row[at.scale_0 + k] - r[at.scale_0 + k]));
    }
    for (let k = 0; k < kRest; ++k)
      if (row[at.f_rest_0 + k] !== undefined || hasRest) note('shRest', Math.abs(row[at.f_rest_0 + k] - r[at.f_rest_0 + k]));
    note('opacity', Math.abs(sigmoid(row[at.opacity]) - sigmoid(r[at.opacity])));
    let dot = 0, square = 0;
    for (let k = 0; k < 4; ++k) dot += row[at.rot_0 + k] * r[at.rot_0 + k], square += row[at.rot_0 + k] ** 2;
    note('angle', 2 * Math.acos(Math.min(1, Math.abs(dot) / Math.sqrt(square))));
  }
  return result;
}

const byCell = rows => new Map(rows.map(row => [cellOf(row), row]));

function report(what, rows, reference, tolerance, hasRest = true) {
  check(rows.length === kCount, `${what}: ${rows.length} rows and not ${kCount}`);
  const found = largestDifferences(rows, reference, hasRest);
  const text = Object.entries(found).map(([kind, value]) => `${kind} ${value.toPrecision(2)}`).join(', ');
  console.log(`${what}: ${text}`);
  check(!('missing' in found), `${what}: a row is not where it was`);
  for (const [kind, most] of Object.entries(tolerance)) check(found[kind] <= most, `${what}: ${kind} ${found[kind]} > ${most}`);
}

// What a format may lose of this model. The palette of .sog is no match for random SH; splat-transform decodes .splat's rotations
// with another zero point.
// An angle is the arc cosine of a rounded number, even where nothing differs.
const exact = {position: 0, sh0: 0, shRest: 0, opacity: 0, scale: 0, angle: 1e-3};
const bytes = {opacity: 0.0021, angle: 0.012};
const tolerances = {
  '.ply': exact,
  '.compressed.ply': {...bytes, position: 0.005, sh0: 0.012, shRest: 0.0161, scale: 0.005},
  '.splat': {...bytes, position: 1e-6, sh0: 0.008, shRest: 0, scale: 1e-6, angle: 0.04},
  '.spz': {...bytes, position: 0.00013, sh0: 0.0135, shRest: 0.0665, scale: 0.032},
  '.4.spz': {...bytes, position: 0.00013, sh0: 0.0135, shRest: 0.0665, scale: 0.032},
  '.sog': {...bytes, position: 0.0004, sh0: 0.03, shRest: 1.1, scale: 0.05, angle: 0.02},
};
const agreement = {position: 1e-5, sh0: 1e-4, shRest: 1e-4, opacity: 1e-4, scale: 1e-4, angle: 2e-3};

rmSync(folder, {recursive: true, force: true});
mkdirSync(folder, {recursive: true});
const rows = Array.from({length: kCount}, (_, i) => randomRow(i));
const reference = byCell(rows);
writePly(file('model.ply'), rows);

for (const [ending, tolerance] of Object.entries(tolerances)) {
  const version = ending === '.4.spz' ? ['--spz-version', '4'] : [];
  const written = file(`ours${ending}`);
  ours(file('model.ply'), written, ...version);
  theirs(written, `${written}.theirs.csv`);
  ours(written, `${written}.ours.ply`);
  const seen = readCsv(`${written}.theirs.csv`);
  report(`our ${ending}, read by splat-transform`, seen, reference, tolerance, ending !== '.splat');
  report(`our ${ending}, read by us and by splat-transform`, readPly(`${written}.ours.ply`), byCell(seen),
         ending === '.splat' ? {...agreement, angle: 0.02} : agreement, ending !== '.splat');
}

for (const ending of ['.ply', '.compressed.ply', '.spz', '.4.spz', '.sog']) {
  const written = file(`theirs${ending}`);
  theirs(...(ending === '.spz' ? ['--spz-version', '3'] : []), file('model.ply'), written);
  theirs(written, `${written}.theirs.csv`);
  ours(written, `${written}.ours.ply`);
  report(`splat-transform's ${ending}, read by us and by itself`, readPly(`${written}.ours.ply`),
         byCell(readCsv(`${written}.theirs.csv`)), agreement);
}

// --- .glb

const kExtension = 'KHR_gaussian_splatting';

function parseGlb(path) {
  const data = readFileSync(path);
  check(data.toString('latin1', 0, 4) === 'glTF' && data.readUInt32LE(4) === 2, `${path}: magic and version`);
  check(data.readUInt32LE(8) === data.length, `${path}: length`);
  const jsonBytes = data.readUInt32LE(12);
  check(data.toString('latin1', 16, 20) === 'JSON' && jsonBytes % 4 === 0, `${path}: JSON chunk`);
  const document = JSON.parse(data.toString('utf8', 20, 20 + jsonBytes));
  const binary = 20 + jsonBytes;
  check(data.toString('latin1', binary + 4, binary + 8) === 'BIN\0', `${path}: BIN chunk`);
  const buffer = data.subarray(binary + 8, binary + 8 + data.readUInt32LE(binary));
  const primitive = document.meshes[0].primitives[0];
  const attributes = {};
  for (const [name, index] of Object.entries(primitive.attributes)) {
    const accessor = document.accessors[index], view = document.bufferViews[accessor.bufferView];
    const components = {SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4}[accessor.type];
    const bytesEach = {5121: 1, 5126: 4}[accessor.componentType];
    const begin = (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0), length = accessor.count * components * bytesEach;
    const part = Uint8Array.prototype.slice.call(buffer, begin, begin + length);
    check(part.length === length, `${path}: ${name} lies in the buffer`);
    attributes[name] = {accessor, components, values: bytesEach === 4 ? new Float32Array(part.buffer) : part};
  }
  return {document, primitive, attributes};
}

function checkGlb() {
  ours(file('model.ply'), file('ours.glb'));
  const {document, primitive, attributes} = parseGlb(file('ours.glb'));
  check(document.asset.version === '2.0', 'glb: asset.version');
  check(document.extensionsUsed.includes(kExtension), 'glb: extensionsUsed');
  check(primitive.mode === 0, 'glb: points');
  const extension = primitive.extensions[kExtension];
  check(extension.kernel === 'ellipse' && extension.colorSpace === 'srgb_rec709_display', 'glb: kernel and color space');
  const get = name => attributes[name === 'POSITION' || name === 'COLOR_0' ? name : `${kExtension}:${name}`];
  const near = (a, b) => Math.abs(a - b) <= 1e-6 * Math.abs(b);
  rows.forEach((row, i) => {
    const value = (name, k) => get(name).values[get(name).components * i + k];
    for (let k = 0; k < 3; ++k) {
      check(value('POSITION', k) === (k < 2 ? -1 : 1) * row[k], 'glb: POSITION');
      check(near(value('SCALE', k), Math.exp(row[at.scale_0 + k])), 'glb: SCALE');
      check(value('SH_DEGREE_0_COEF_0', k) === row[at.f_dc_0 + k], 'glb: SH of degree 0');
      for (let degree = 1, c = 0; degree <= 3; ++degree)
        for (let m = 0; m <= 2 * degree; ++m, ++c)
          check(value(`SH_DEGREE_${degree}_COEF_${m}`, k) === (((m - degree) % 2) ? -1 : 1) * row[at.f_rest_0 + k * kRestPerChannel + c],
                `glb: SH ${degree} ${m}`);
    }
    check(near(value('OPACITY', 0), sigmoid(row[at.opacity])), 'glb: OPACITY');
    const [w, x, y, z] = [0, 1, 2, 3].map(k => row[at.rot_0 + k]);
    [-y, x, w, -z].forEach((expected, k) => check(Math.abs(value('ROTATION', k) - expected) < 3e-7, 'glb: ROTATION'));
  });
  for (const bound of ['min', 'max'])
    get('POSITION').accessor[bound].forEach((value, k) => {
      const column = rows.map(row => (k < 2 ? -1 : 1) * row[k]);
      check(Math.fround(value) === Math[bound](...column), `glb: POSITION.${bound}`);
    });
  theirs(file('model.ply'), file('theirs.glb'));
  ours(file('theirs.glb'), file('theirs.glb.ours.ply'));
  report('splat-transform\'s .glb, read by us', readPly(file('theirs.glb.ours.ply')), reference, {...exact, opacity: 1e-6, scale: 1e-5});
  const other = parseGlb(file('theirs.glb')).attributes;
  let differing = 0, largest = 0;
  for (const [name, {values}] of Object.entries(attributes)) {
    if (name === 'COLOR_0') continue;
    check(name in other, `splat-transform's glb has ${name}`);
    values.forEach((value, i) => {
      const difference = Math.abs(value - other[name].values[i]) / Math.max(1, Math.abs(value));
      if (difference > 0) ++differing;
      largest = Math.max(largest, difference);
    });
  }
  check(largest < 1e-6, `glb: differs from splat-transform's by ${largest}`);
  console.log(`our .glb against splat-transform's: ${differing} of ${kCount * 59} floats differ, by ${largest.toPrecision(2)} at the most`);
}

async function validateGlb() {
  const validator = require(join(packages, 'gltf-validator'));
  const result = await validator.validateBytes(new Uint8Array(readFileSync(file('ours.glb'))), {maxIssues: 0});
  // It does not know the extension, and so neither its name nor its attributes.
  const isUnknown = issue => issue.code === 'UNSUPPORTED_EXTENSION' ||
      (issue.code === 'MESH_PRIMITIVE_INVALID_ATTRIBUTE' && /KHR_gaussian_splatting/.test(issue.message + issue.pointer));
  const issues = result.issues.messages;
  const others = issues.filter(issue => issue.severity < 2 && !isUnknown(issue));
  console.log(`gltf-validator: ${issues.length - others.length} issues of names that it does not know, ${others.length} others`);
  for (const issue of others) check(false, `gltf-validator: ${issue.code} ${issue.message} ${issue.pointer}`);
}

checkGlb();
await validateGlb();
console.log(failures ? `${failures} checks failed` : 'all formats agree');
process.exit(failures ? 1 : 0);
