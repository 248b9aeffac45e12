// SPDX-License-Identifier: Apache-2.0
// Which program reads which of our files: runs each reader on each file, and writes a table.
//   node matrix.mjs MODULES PROGRAM OUT CHROMIUM [--write | --only READER]
// MODULES holds node_modules (package.json beside this file). OUT gets files and pictures. With --write
// docs/formats/readers.md gets the table between its marks, and docs/formats/readers.json the
// results; without, the results are compared with that file, and a difference is a failure.
import {execFileSync} from 'node:child_process';
import {createRequire} from 'node:module';
import {existsSync, mkdirSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {dirname, join, resolve} from 'node:path';
import {fileURLToPath} from 'node:url';
import {RangeServer} from '../range_server.mjs';
import {GAUSSIANS, judge, writeCross} from './cross.mjs';
import {CESIUM_PAGE, PAGES, SIZE} from './pages.mjs';

const [modules, program, out] = process.argv.slice(2, 5).map(path => resolve(path)), chromium = process.argv[5];
const here = dirname(fileURLToPath(import.meta.url)), docs = resolve(here, '../../../docs');
const require = createRequire(join(modules, 'package.json'));
const file = (...names) => join(out, ...names);
const gemsplat = (...words) => execFileSync(program, [...words, '-q', '--no-measure'], {stdio: ['ignore', 'ignore', 'pipe']});
const versionOf = name => JSON.parse(readFileSync(join(modules, 'node_modules', name, 'package.json'), 'utf8')).version;
const PLACE = [15.5, 48.2, 300];  // longitude, latitude, height of the tileset
const only = process.argv[6] === '--only' ? process.argv[7] : null;
const SECONDS = 40;               // for one picture

// --- our files

/// Format -> the file that a reader is given, relative to OUT.
const FILES = {
  '.ply': 'cross.ply', '.compressed.ply': 'cross.compressed.ply', '.splat': 'cross.splat', '.spz version 2': 'v2.spz',
  '.spz version 3': 'v3.spz', '.spz version 4': 'v4.spz', '.sog': 'cross.sog', '.glb': 'cross.glb',
  '.rad': 'cross.rad', 'tileset.json': 'tiles/tileset.json', '.glb of a tile': 'tiles/0/0.glb',
};

function writeFiles() {
  rmSync(out, {recursive: true, force: true});
  mkdirSync(out, {recursive: true});
  writeCross(file('model.ply'));
  for (const name of ['cross.ply', 'cross.compressed.ply', 'cross.splat', 'cross.sog', 'cross.glb', 'cross.rad']) gemsplat('export', file('model.ply'), file(name));
  for (const version of [2, 3, 4]) gemsplat('export', file('model.ply'), file(`v${version}.spz`), '--spz-version', String(version), '--spz-sh-bits', '8');
  // x stays, y down becomes up, z forward becomes north.
  writeFileSync(file('georef.json'), JSON.stringify({version: 1, source: 'a test', heights: 'above the ellipsoid', origin: PLACE,
                                                      enu_from_input: [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]}));
  gemsplat('export', file('model.ply'), `${file('tiles')}/`, '--georef', file('georef.json'));
}

// --- readers without a page

// splat-transform writes what it has read as .csv.
function splatTransform(path) {
  const csv = `${path}.csv`;
  execFileSync(process.execPath, [join(modules, 'node_modules/@playcanvas/splat-transform/bin/cli.mjs'), '-w', '-q', '-g', 'cpu', path, csv], {stdio: ['ignore', 'pipe', 'pipe']});
  const [head, ...rows] = readFileSync(csv, 'utf8').trim().split('\n').map(line => line.split(','));
  const column = name => head.indexOf(name), number = (row, name) => Number(row[column(name)]);
  const wanted = Object.values(GAUSSIANS);
  if (rows.length !== wanted.length) return {verdict: 'wrong', detail: `${rows.length} Gaussians`};
  let hasSh = true;
  for (const {at, color, redAlongZ} of wanted) {
    const row = rows.find(row => Math.hypot(...['x', 'y', 'z'].map((name, k) => number(row, name) - at[k])) < 0.02);
    if (!row) return {verdict: 'wrong', detail: `no Gaussian is at ${at}`};
    if (color.some((c, k) => Math.abs(0.5 + 0.28209479 * number(row, `f_dc_${k}`) - c) > 0.02)) return {verdict: 'wrong', detail: `another color at ${at}`};
    if (redAlongZ && column('f_rest_1') < 0) hasSh = false;
    else if (redAlongZ && Math.abs(number(row, 'f_rest_1') * 0.4886 - redAlongZ) > 0.03) return {verdict: 'wrong', detail: 'another SH coefficient'};
  }
  return {verdict: hasSh ? 'right' : 'right, without SH', detail: ''};
}

async function gltfValidator(path) {
  const {issues} = await require('gltf-validator').validateBytes(new Uint8Array(readFileSync(path)), {maxIssues: 0});
  const isUnknown = ({code, message, pointer}) => code === 'UNSUPPORTED_EXTENSION' || /KHR_gaussian_splatting/.test(message + pointer);
  const others = issues.messages.filter(issue => issue.severity < 2 && !isUnknown(issue));
  if (others.length) return {verdict: 'wrong', detail: `${others.length} issues: ${others[0].code} ${others[0].message} ${others[0].pointer}`};
  return {verdict: 'right', detail: 'nothing but names that it does not know'};
}

// --- readers in a page

async function bundles() {
  const pages = {};
  for (const [reader, {script}] of Object.entries(PAGES)) {
    const {outputFiles: [{text}]} = await require('esbuild').build({
      stdin: {contents: script, resolveDir: modules}, bundle: true, write: false, format: 'esm',
      minify: true, target: 'es2022', logLevel: 'error', external: ['node:*']});
    pages[`${reader}.js`] = text;
    pages[`${reader}.html`] = `<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,"><style>body { margin: 0; background: black; overflow: hidden }</style><body><script type="module">${text.replace(/<\/script/g, '<\\/script')}</script>`;
  }
  return {...pages, 'CesiumJS.html': CESIUM_PAGE};
}

const READ = `async data => {
  const image = new Image();
  image.src = 'data:image/png;base64,' + data;
  await image.decode();
  const context = new OffscreenCanvas(image.width, image.height).getContext('2d');
  context.drawImage(image, 0, 0);
  return Array.from(context.getImageData(0, 0, image.width, image.height).data);
}`;

async function inPage(browser, server, reader, name) {
  const page = await browser.newPage({viewport: {width: SIZE, height: SIZE}});
  const errors = [];
  page.on('pageerror', ({message}) => errors.push(message));
  page.on('console', message => { if (message.type() === 'error') errors.push(message.text()); });
  try {
    await page.goto(`${server.url}${encodeURIComponent(reader)}.html`);
    await page.waitForFunction('window.show', null, {timeout: 1000 * SECONDS});
    const shown = page.evaluate(`show(${JSON.stringify(`${server.url}files/${name}`)}, ${JSON.stringify(PLACE)})`);
    const late = new Promise((_, failed) => setTimeout(() => failed(new Error(errors[0] ?? `nothing after ${SECONDS} s`)), 1000 * SECONDS));
    await Promise.race([shown, late]);
    const png = await page.screenshot();
    writeFileSync(file('pictures', `${reader} ${name.replaceAll('/', ' ')}.png`), png);
    const data = Uint8Array.from(await page.evaluate(`(${READ})(${JSON.stringify(png.toString('base64'))})`));
    const result = judge({data, size: SIZE});
    return result.verdict === 'nothing' && errors.length ? {verdict: 'not read', detail: errors[0]} : result;
  } catch ({message}) {
    return {verdict: 'not read', detail: message};
  } finally {
    await page.close();
  }
}

// --- all of them

const isGlb = format => format.startsWith('.glb');
const COLUMNS = [
  {reader: 'splat-transform', name: '@playcanvas/splat-transform', reads: format => !isGlb(format) && format !== 'tileset.json'},
  ...Object.entries(PAGES).map(([reader, {name}]) => ({reader, name, reads: format => format !== 'tileset.json', page: true})),
  {reader: 'CesiumJS', name: 'cesium', reads: format => isGlb(format) || format === 'tileset.json', page: true},
  {reader: 'gltf-validator', name: 'gltf-validator', reads: isGlb, check: true},
];

async function resultOf({reader, page, check}, format, browser, server) {
  const path = file(...FILES[format].split('/'));
  try {
    if (page) return await inPage(browser, server, reader, FILES[format]);
    return check ? await gltfValidator(path) : splatTransform(path);
  } catch (error) {
    return {verdict: 'not read', detail: String(error.stderr || error.message)};
  }
}

const oneLine = text => text.replace(/\s+/g, ' ').replaceAll(/http:\/\/127\.0\.0\.1:\d+/g, '').replaceAll(out, '').trim().slice(0, 160);

async function run() {
  writeFiles();
  mkdirSync(file('pictures'));
  const {chromium: launcher} = require('playwright-core');
  const browser = await launcher.launch({executablePath: chromium, args: [
    '--headless', '--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
    '--ignore-gpu-blocklist', '--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1']});
  const packages = join(modules, 'node_modules');
  const server = await RangeServer.start({
    roots: {files: out, cesium: join(packages, 'cesium/Build/Cesium'),
            'adobe-spz': join(packages, '@adobe/spz/dist')},
    pages: await bundles()});
  const results = {};
  for (const format of Object.keys(FILES))
    for (const column of COLUMNS) {
      if (!column.reads(format) || (only && column.reader !== only)) continue;
      const {verdict, detail} = await resultOf(column, format, browser, server);
      (results[format] ??= {})[column.reader] = {verdict, detail: oneLine(detail)};
      console.log(`${format}, ${column.reader}: ${verdict} ${oneLine(detail)}`);
    }
  const chrome = browser.version();
  await browser.close();
  await server.close();
  return {chromium: chrome, readers: Object.fromEntries(COLUMNS.map(({reader, name}) => [reader, versionOf(name)])), results};
}

const WORDS = {right: 'yes', 'right, without SH': 'yes, without SH', wrong: 'wrong', nothing: 'no', 'not read': 'no'};

function table({readers, results}) {
  const heads = Object.entries(readers).map(([reader, version]) => `${reader} ${version}`);
  const rows = Object.entries(results).map(([format, row]) => [format.replace(/^(\S+)(.*)$/, '`$1`$2'), ...Object.keys(readers).map(reader => row[reader] ? WORDS[row[reader].verdict] : '')]);
  return [['our file', ...heads], ['our file', ...heads].map(() => '---'), ...rows].map(row => `| ${row.join(' | ')} |`).join('\n').replace(/\| --- /g, '|---').replace('--- |', '---|') + '\n';
}

const BEGIN = '<!-- the table of tests/interop/readers -->\n', END = '<!-- its end -->';
const found = await run(), kept = join(docs, 'formats/readers.json');
if (process.argv[6] === '--write') {
  const page = join(docs, 'formats/readers.md'), text = readFileSync(page, 'utf8'), [before, rest] = text.split(BEGIN), after = rest.slice(rest.indexOf(END));
  writeFileSync(page, before + BEGIN + table(found) + after);
  mkdirSync(dirname(kept), {recursive: true});
  writeFileSync(kept, JSON.stringify(found, null, 1) + '\n');
} else {
  const before = existsSync(kept) ? JSON.parse(readFileSync(kept, 'utf8')).results : {};
  let failures = 0;
  for (const [format, row] of Object.entries(found.results))
    for (const [reader, {verdict}] of Object.entries(row))
      if (before[format]?.[reader]?.verdict !== verdict) {
        ++failures;
        console.log(`FAILED: ${format}, ${reader}: ${verdict}, and docs/formats/readers.json says ${before[format]?.[reader]?.verdict}`);
      }
  process.exit(failures ? 1 : 0);
}
