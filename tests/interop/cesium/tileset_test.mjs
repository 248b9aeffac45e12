// SPDX-License-Identifier: Apache-2.0
// CesiumJS shows our tilesets where they are, in the right colors and the right way up.
//   node tileset_test.mjs MODULES PROGRAM OUT CHROMIUM SCENE
//   1. A cross of Gaussians at known places east, north and up of a known place on earth: pixels at a
//      near and a far camera, which CesiumJS places by its own geodesy.
//   2. A ball of many Gaussians: which level is shown near and far, and how it looks.
//   3. A short run on SCENE: CesiumJS against `gemsplat render`.
// MODULES holds node_modules with cesium and playwright-core.
import {execFileSync} from 'node:child_process';
import {mkdirSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';
import {Browser} from '../../../apps/web/tests/browser.mjs';
import {colorsAt, psnr} from '../../../apps/web/tests/pictures.mjs';
import {serveMap, startMap} from './map_page.mjs';

const [modules, program, out, chromium, scene] = process.argv.slice(2);
const gemsplat = (...words) => execFileSync(program, [...words, '-q'], {stdio: ['ignore', 'pipe', 'inherit']}).toString();
const file = name => join(out, name);
let failures = 0;
function check(isTrue, what) {
  if (!isTrue) ++failures;
  console.log(`${isTrue ? 'ok' : 'FAILED'}: ${what}`);
}

// --- where the scene stands: one unit is 7.5 m, its axes are turned about (1, 2, 3)

const PLACE = [15.5, 48.2, 300], SCALE = 7.5, SHIFT = [12, -30, 4];
const WIDTH = 640, HEIGHT = 480, FOCAL = 700;  // pixels

const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
const minus = (a, b) => a.map((x, i) => x - b[i]);
const unit = v => v.map(x => x / Math.hypot(...v));
function turnAbout(axis, angle) {  // Rodrigues' formula, by rows
  const [x, y, z] = unit(axis), c = Math.cos(angle), s = Math.sin(angle), k = 1 - c;
  return [[c + x * x * k, x * y * k - z * s, x * z * k + y * s], [y * x * k + z * s, c + y * y * k, y * z * k - x * s],
          [z * x * k - y * s, z * y * k + x * s, c + z * z * k]];
}
const TURN = turnAbout([1, 2, 3], 2.2);
const COLUMNS = [0, 1, 2].map(j => TURN.map(row => row[j]));
const inputOf = enu => COLUMNS.map(column => dot(column, minus(enu, SHIFT)) / SCALE);
const enuOf = input => TURN.map((row, i) => SCALE * dot(row, input) + SHIFT[i]);
const turnToInput = v => COLUMNS.map(column => dot(column, v));
const turnToEnu = v => TURN.map(row => dot(row, v));

function writeGeoref(path) {
  const rows = [...TURN.map((row, i) => [...row.map(x => SCALE * x), SHIFT[i]]), [0, 0, 0, 1]];
  writeFileSync(path, JSON.stringify({version: 1, source: 'a test', heights: 'above the ellipsoid', origin: PLACE, enu_from_input: rows}));
}

// --- cameras, in meters east, north, up

function lookingAt(position, target, name) {
  const direction = unit(minus(target, position)), right = unit(cross(direction, [0, 0, 1]));
  return {name, position, direction, up: cross(right, direction), right};
}
const project = ({position, direction, up, right}, point) => {
  const d = minus(point, position), z = dot(d, direction);
  return [WIDTH / 2 + FOCAL * dot(d, right) / z, HEIGHT / 2 - FOCAL * dot(d, up) / z];
};
const forGemsplat = ({name, position, direction, up, right}, id) => {
  const axes = [turnToInput(right), turnToInput(up).map(x => -x), turnToInput(direction)];  // columns
  return {id, img_name: name, width: WIDTH, height: HEIGHT, fx: FOCAL, fy: FOCAL, cx: WIDTH / 2, cy: HEIGHT / 2,
          position: inputOf(position), rotation: [0, 1, 2].map(i => axes.map(axis => axis[i]))};
};
const forCesium = ({position, direction, up}) => ({position, direction, up, fieldOfView: 2 * Math.atan(WIDTH / 2 / FOCAL)});

// Pictures of a tileset and of its model from the same cameras: [{camera, theirs, ours, state}].
async function pictures(page, url, cameras, model, folder, screenSpaceError) {
  writeFileSync(file(`${folder}.json`), JSON.stringify(cameras.map(forGemsplat)));
  gemsplat('render', model, '--cameras', file(`${folder}.json`), '-o', file(folder), '--device', 'cpu');
  await startMap(page, url, PLACE, screenSpaceError);
  const results = [];
  for (const camera of cameras) {
    await page.evaluate(`map.look(${JSON.stringify(forCesium(camera))})`);
    const state = await page.evaluate('map.settled()'), theirs = await page.screenshot();
    writeFileSync(file(`${folder}-${camera.name}-cesium.png`), theirs);
    results.push({camera, theirs, ours: readFileSync(join(file(folder), `${camera.name}.png`)), state});
  }
  for (const failure of await page.evaluate('map.failures')) check(false, failure);
  return results;
}

// --- models, made of Gaussians [{at (meters east, north, up), color, rest, sigma (meters)}]

const OPACITY = 0.95, C0 = 0.28209479177387814;

function writePly(path, gaussians) {
  const names = ['x', 'y', 'z', 'f_dc_0', 'f_dc_1', 'f_dc_2', ...Array.from({length: 9}, (_, i) => `f_rest_${i}`), 'opacity',
                 'scale_0', 'scale_1', 'scale_2', 'rot_0', 'rot_1', 'rot_2', 'rot_3'];
  const none = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  const rows = gaussians.map(({at, color, rest = none, sigma}) => [
    ...inputOf(at), ...color.map(c => (c - 0.5) / C0), ...[0, 1, 2].flatMap(channel => rest.map(c => c[channel])),
    Math.log(OPACITY / (1 - OPACITY)), ...[1, 1, 1].map(() => Math.log(sigma / SCALE)), 1, 0, 0, 0]);
  const header = `ply\nformat binary_little_endian 1.0\nelement vertex ${rows.length}\n` +
      names.map(name => `property float ${name}\n`).join('') + 'end_header\n';
  writeFileSync(path, Buffer.concat([Buffer.from(header), Buffer.from(Float32Array.from(rows.flat()).buffer)]));
}
const exportTiles = (model, folder, ...more) =>
    gemsplat('export', model, `${folder}/`, '--georef', file('georef.json'), '--no-measure', ...more);
const inWindow = (browser, server) => browser.openServer(server.url, {width: WIDTH, height: HEIGHT});

// --- 1. the cross: 10 m from the place; the last color changes with the direction (SH of degree 1)

const CROSS = [
  {at: [10, 0, 0], color: [0.9, 0.1, 0.1]}, {at: [0, 10, 0], color: [0.1, 0.8, 0.1]}, {at: [0, 0, 10], color: [0.2, 0.2, 0.9]},
  {at: [-10, 0, 0], color: [0.5, 0.5, 0.5]}, {at: [0, -10, 0], color: [0.5, 0.5, 0.5], rest: [[0.25, 0, 0], [0, 0.25, 0], [0, 0, -0.25]]},
].map(gaussian => ({...gaussian, sigma: 1.2}));
const NEAR = lookingAt([25, -40, 20], [0, 0, 0], 'near'), FAR = lookingAt([-150, -210, 120], [0, 0, 0], 'far');

// The middle of the light within 5 pixels of a place.
async function middleOf(page, png, place) {
  const around = Array.from({length: 11 * 11}, (_, i) => [Math.floor(place[0]) - 5 + i % 11, Math.floor(place[1]) - 5 + Math.floor(i / 11)]);
  const light = (await colorsAt(page, png, around)).map(color => dot(color, [1, 1, 1])), sum = light.reduce((a, b) => a + b, 0);
  return [0, 1].map(k => around.reduce((total, at, i) => total + light[i] * (at[k] + 0.5), 0) / sum);
}

async function testCross(browser, server) {
  writePly(file('cross.ply'), CROSS);
  exportTiles(file('cross.ply'), file('cross'));
  const page = await inWindow(browser, server);
  const seen = await pictures(page, '/files/cross/tileset.json', [NEAR, FAR], file('cross.ply'), 'cross-ours');
  const place = await page.evaluate('map.placeOf([0, 0, 0])');
  // 1e-7 degrees are 1 cm.
  check(Math.hypot((place[0] - PLACE[0]) * 0.67, place[1] - PLACE[1]) < 1e-7 && Math.abs(place[2] - PLACE[2]) < 0.01,
        `the tileset's middle is at ${place.map(x => x.toFixed(8)).join(', ')}`);
  for (const {camera, theirs, ours} of seen) {
    for (const {at, color, rest} of CROSS) {
      const expected = project(camera, at), what = `${camera.name}, the Gaussian at ${at}`;
      const [shown] = await colorsAt(page, theirs, [expected]), [own] = await colorsAt(page, ours, [expected]);
      // .spz keeps colors and opacity as bytes and SH in steps of 1/16, which is 3 in 255. Far away the pixel misses the peak.
      const wanted = rest || camera === FAR ? own : color.map(c => Math.round(255 * OPACITY * c));
      check(Math.max(...minus(shown, wanted).map(Math.abs)) <= 4, `${what} has the color ${shown} for ${wanted}`);
      if (camera !== FAR) continue;
      const pixels = Math.hypot(...minus(await middleOf(page, theirs, expected), expected));
      // Gaussians of 3 pixels, 15 and more apart, seen through a window of whole pixels. Half a pixel is 20 cm there.
      check(pixels < 0.5, `${what} is ${pixels.toFixed(2)} pixels from its place`);
    }
    const dB = await psnr(page, theirs, ours);
    // An error of 1.4 in 255 everywhere; measured: 60 and 71 dB.
    check(dB > 45, `${camera.name}, the cross agrees with gemsplat render: ${dB.toFixed(2)} dB`);
  }
  await page.close();
}

// --- 2. a ball with levels: 8,000 Gaussians of 14 cm, in colors that name the direction, and a checkerboard. There are two layers, 5
// and 4.8 m from the middle, so that holes between merged Gaussians do not show the other side.

const GOLDEN = Math.PI * (3 - Math.sqrt(5)), COUNT = 8000;
const BALL = Array.from({length: COUNT}, (_, i) => {
  const z = 1 - (2 * i + 1) / COUNT, r = Math.sqrt(1 - z * z), n = [r * Math.cos(GOLDEN * i), r * Math.sin(GOLDEN * i), z];
  const shade = Math.sin(6 * n[0]) * Math.sin(6 * n[2]) > 0 ? 1 : 0.6;
  return {at: n.map(x => (i % 2 ? 4.8 : 5) * x), color: n.map(x => shade * (0.5 + 0.4 * x)), sigma: 0.14};
});
const levelsOf = (tile, level = 0) => [[tile.content.uri, level], ...(tile.children ?? []).flatMap(child => levelsOf(child, level + 1))];

// The pixels that hold a ball about the place, with a margin.
function boxOf(camera, radius) {
  const [x, y] = project(camera, [0, 0, 0]), reach = Math.min(HEIGHT / 2, Math.ceil(1.2 * FOCAL * radius / Math.hypot(...camera.position)));
  return [x - reach, y - reach, x + reach, y + reach].map(Math.round);
}

async function testLevels(browser, server) {
  writePly(file('ball.ply'), BALL);
  exportTiles(file('ball.ply'), file('ball'), '--tile-gaussians', '2000');
  const level = Object.fromEntries(levelsOf(JSON.parse(readFileSync(file('ball/tileset.json'), 'utf8')).root));
  const deepest = Math.max(...Object.values(level)), toward = unit([-0.5, -0.7, 0.4]);
  const cameras = [15, 150, 300].map(meters => lookingAt(toward.map(x => meters * x), [0, 0, 0], `at-${meters}-m`));
  const page = await inWindow(browser, server);
  const seen = await pictures(page, '/files/ball/tileset.json', cameras, file('ball.ply'), 'ball-ours');
  const shown = seen.map(({state}) => Math.min(...state.selected.map(url => level[url.replace(/.*[/]ball[/]/, '')])));
  check(shown[0] === deepest && seen[0].state.drawn === BALL.length, `near, the leaves are shown: ${seen[0].state.drawn} Gaussians`);
  for (const far of [1, 2])
    check(shown[far] < shown[far - 1] && seen[far].state.drawn < seen[far - 1].state.drawn,
          `${cameras[far].name}, level ${shown[far]} of ${deepest} is shown: ${seen[far].state.drawn} Gaussians`);
  // Measured: 47.9, 25.8 and 18.0 dB; near only .spz differs, then one Gaussian stands for two, and for eight. Our own far pictures,
  // mirrored, are at 15.1 and 14.9 dB.
  for (const [i, least] of [40, 22, 16.5].entries()) {
    const {camera, theirs, ours} = seen[i], dB = await psnr(page, theirs, ours, boxOf(camera, 5));
    check(dB > least, `${camera.name}, the ball agrees with gemsplat render: ${dB.toFixed(2)} dB`);
  }
  await page.close();
}

// --- 3. a short run of a real scene, with SH of degree 3 and Gaussians of every shape

const SHORT = ['--device', 'cpu', '-r', '4', '-i', '300', '--eval',
               '--set', 'density.max_gaussians=5000'];

async function testRun(browser, server) {
  const run = file('run');
  gemsplat('train', scene, '-o', run, ...SHORT);
  exportTiles(run, file('run-tiles'), '--tile-gaussians', '1000');
  const cameras = JSON.parse(readFileSync(join(run, 'cameras.json'), 'utf8')).slice(0, 2).map((photo, i) => {
    const axis = j => turnToEnu(photo.rotation.map(row => row[j]));
    return {name: `photo-${i}`, direction: axis(2), up: axis(1).map(x => -x), right: axis(0), position: enuOf(photo.position)};
  });
  const page = await inWindow(browser, server);
  for (const {camera, theirs, ours} of await pictures(page, '/files/run-tiles/tileset.json', cameras, run, 'run-ours')) {
    const dB = await psnr(page, theirs, ours);
    // Measured: 31.7 and 28.8 dB. CesiumJS clamps colors before it adds SH, and cuts splats off nearer to their middle. A picture
    // that is mirrored, or of which red and blue are swapped, has less than 20 dB.
    check(dB > 26, `${camera.name}, the run agrees with gemsplat render: ${dB.toFixed(2)} dB`);
  }
  await page.close();
}

rmSync(out, {recursive: true, force: true});
mkdirSync(out, {recursive: true});
writeGeoref(file('georef.json'));
const server = await serveMap(join(modules, 'node_modules'), out);
const browser = await Browser.start(modules, chromium, {server: true});
browser.context.setDefaultTimeout(120_000);
await testCross(browser, server);
await testLevels(browser, server);
await testRun(browser, server);
await browser.close();
await server.close();
for (const failure of browser.failures) check(false, failure);
process.exit(failures ? 1 : 0);
