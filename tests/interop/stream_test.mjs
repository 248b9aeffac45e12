// SPDX-License-Identifier: Apache-2.0
// Levels of detail in the viewers for which they are written: pictures of the streamed SOG in
// PlayCanvas and of the .rad in Spark (`gemsplat view`) against pictures of `gemsplat render`, from a
// near and a far camera, and what arrives before the first picture.
//   node stream_test.mjs PACKAGES WEB PROGRAM SCENE OUT CHROMIUM
// PACKAGES holds playcanvas; WEB/node_modules has playwright-core.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {mkdir, readFile, readdir, rm, stat, writeFile} from 'node:fs/promises';
import {join, resolve} from 'node:path';
import {Browser, finish} from '../../apps/web/tests/browser.mjs';
import {psnr} from '../../apps/web/tests/pictures.mjs';
import {serveProgram} from '../../apps/web/tests/serve_program.mjs';
import {playcanvasPage} from './playcanvas_page.mjs';
import {RangeServer} from './range_server.mjs';

const [packages, web, program, scene, out] = process.argv.slice(2, 7).map(path => resolve(path)), chromium = process.argv[7];
const gemsplat = (...words) => execFileSync(program, [...words, '-q', '--device', 'cpu'], {stdio: ['ignore', 'pipe', 'inherit']}).toString();
const file = (...names) => join(out, ...names);

// dB that PlayCanvas' picture must reach against ours, and by which it must beat wrong models. Its
// splats end at 2.8 standard deviations and are no wider than the picture, and its colors have 11,
// 11 and 10 bits; so it is not closer. Measured: 30.7 to 35.0, and ahead by 2.9 or more.
const LEAST = 27, AHEAD = 2;
// Spark in our page has our kernel and blends in 16 bits. Measured: 58.4 and 59.1; without the SH of
// degree 3, which Spark itself loses (spark_fix.mjs), 49.6 and 51.7.
const LEAST_SPARK = 55;
// Of the streamed SOG's bytes, at the first picture that shows the whole model. Measured: 0.045.
const FIRST_SHARE = 0.05;

// Of the folder's streamed SOG.
const bytesOf = async folder => {
  let sum = 0;
  for (const entry of await readdir(folder, {recursive: true, withFileTypes: true}))
    if (entry.isFile() && entry.name !== 'model.rad') sum += (await stat(join(entry.path, entry.name))).size;
  return sum;
};

// Pictures of ours, by camera: near is a camera of the run, far the same three times as far away.
async function render(model, name, cameras) {
  gemsplat('render', model, '--cameras', cameras, '-r', '1', '-o', file(name));
  return {near: await readFile(file(name, 'near.png')), far: await readFile(file(name, 'far.png'))};
}

// `gemsplat view` at one of the cameras, without interface; change(page) runs before it settles.
async function spark(browser, name, index, change) {
  const {width, height} = cameras[name], server = await serveProgram(program, 'view', file('lod', 'model.rad'), '--cameras', cameraFile, '--no-open', '--port', '0');
  const page = await browser.openServer(server.url, {at: `c=${index}&ui=0`, width, height});
  await page.waitForFunction(() => window.gemsplatViewer?.ready.then(() => true));
  if (change) await page.evaluate(change);
  await page.waitForFunction(() => gemsplatViewer.settled().then(() => true));
  const png = await page.screenshot({path: file(`spark-${name}${change ? '-changed' : ''}.png`)});
  const splats = await page.evaluate(() => document.getElementById('app').viewer.stage.splats.mesh.paged.numSplats);
  await page.close();
  await server.end();
  return {png, splats};
}

async function writeCameras() {
  const [, small] = JSON.parse(await readFile(file('run', 'cameras.json'), 'utf8')), camera = {...small};
  for (const key of ['width', 'height', 'fx', 'fy', 'cx', 'cy']) camera[key] *= 2;  // photos were halved
  const back = camera.rotation.map((row, i) => camera.position[i] - 9 * row[2]);  // z looks forward
  const both = {near: {...camera, id: 0, img_name: 'near'}, far: {...camera, id: 1, img_name: 'far', position: back}};
  await writeFile(file('cameras.json'), JSON.stringify(Object.values(both)));
  return both;
}

// The page's picture after it has settled.
async function picture(browser, server, page, {root, camera, name, ...rest}) {
  const shown = await browser.openServer(server.url + page, {width: camera.width, height: camera.height, own: server.url});
  await shown.waitForFunction(() => window.pageReady);
  await shown.evaluate(what => window.show(what), {camera, ...rest});
  await shown.waitForFunction(() => window.shown && window.settled());
  const png = await shown.screenshot({path: file(`${name}.png`)});
  await shown.close();
  return png;
}

await rm(out, {recursive: true, force: true});
await mkdir(out, {recursive: true});
// With moments as floats: the figures above are those of this model.
gemsplat('train', scene, '-o', file('run'), '-c', 'adaptive', '-r', '2', '-i', '400', '--eval', '--set', 'optimizer.moments=float',
         '--set', 'density.max_gaussians=20000');
gemsplat('export', file('run'), file('lod'), '--lod', '--lod-leaf', '3000', '--no-measure');
const cameras = await writeCameras(), cameraFile = file('cameras.json');
const meta = JSON.parse(await readFile(file('lod', 'lod-meta.json'), 'utf8')), coarsest = meta.lodLevels - 1;
// Models that a reader with a wrong idea of rotations, axes or colors would show.
const wrongs = {
  'rotations inverted': row => { for (const name of ['rot_1', 'rot_2', 'rot_3']) row[name] *= -1; },
  'mirrored': row => { row.x *= -1; row.rot_2 *= -1; row.rot_3 *= -1; },
  'red and blue exchanged': row => { [row.f_dc_0, row.f_dc_2] = [row.f_dc_2, row.f_dc_0]; },
};

// Changes every row of a PLY of floats.
async function changedPly(from, to, change) {
  const bytes = await readFile(from), end = bytes.indexOf('end_header\n') + 11, head = bytes.toString('latin1', 0, end);
  const names = [...head.matchAll(/^property float (\w+)$/gm)].map(([, name]) => name);
  const values = new Float32Array(Uint8Array.prototype.slice.call(bytes, end).buffer);
  for (let at = 0; at < values.length; at += names.length) {
    const row = Object.fromEntries(names.map((name, i) => [name, values[at + i]]));
    change(row);
    names.forEach((name, i) => { values[at + i] = row[name]; });
  }
  await writeFile(to, Buffer.concat([bytes.subarray(0, end), Buffer.from(values.buffer)]));
}

const fine = await render(file('lod'), 'ours-fine', cameraFile);
const coarse = await render(file('lod', `${coarsest}_0`), 'ours-coarse', cameraFile);

const server = await RangeServer.start({
  roots: {playcanvas: join(packages, 'playcanvas'), lod: file('lod')},
  pages: {'playcanvas.html': playcanvasPage, 'blank.html': ''}});
const browser = await Browser.start(web, chromium, {server: true});
browser.context.setDefaultTimeout(120_000);
const sheet = await browser.openServer(server.url + 'blank.html', {own: server.url});  // where PNGs are decoded
const agreement = async (name, ours, theirs) => {
  const dB = await psnr(sheet, ours, theirs);
  console.log(`${name}: ${dB.toFixed(2)} dB`);
  return dB;
};
const playcanvas = (name, camera, budget) => picture(browser, server, 'playcanvas.html', {name: `playcanvas-${name}`, camera, url: '/lod/lod-meta.json', budget});

const tests = {
  async 'PlayCanvas shows the finest level as render does, near and far'() {
    const theirs = {near: await playcanvas('near', cameras.near, 1e6), far: await playcanvas('far', cameras.far, 1e6)};
    const right = {};
    for (const name of ['near', 'far']) {
      right[name] = await agreement(`${name}, finest`, fine[name], theirs[name]);
      assert.ok(right[name] > LEAST);
    }
    gemsplat('export', file('lod'), file('fine.ply'));
    for (const [what, change] of Object.entries(wrongs)) {
      await changedPly(file('fine.ply'), file('wrong.ply'), change);
      const wrong = await render(file('wrong.ply'), `wrong ${what}`, cameraFile);
      for (const name of ['near', 'far'])
        assert.ok(await agreement(`${name}, ${what}`, wrong[name], theirs[name]) < right[name] - AHEAD);
    }
  },

  async 'with a small budget it shows the coarsest level'() {
    for (const name of ['near', 'far']) {
      const theirs = await playcanvas(`${name}-coarse`, cameras[name], 1);
      assert.ok(await agreement(`${name}, coarsest`, coarse[name], theirs) > LEAST);
      assert.ok(await agreement(`${name}, coarsest against finest`, fine[name], theirs) < LEAST);
    }
  },

  async 'the first picture of the whole model needs few of the bytes'() {
    server.sent.length = 0;
    server.isHeld = name => /^[0-9]+_/.test(name) && !name.startsWith(`${coarsest}_`);
    const shown = await browser.openServer(server.url + 'playcanvas.html', {width: cameras.near.width, height: cameras.near.height, own: server.url});
    await shown.waitForFunction(() => window.pageReady);
    await shown.evaluate(what => window.show(what), {camera: cameras.near, url: '/lod/lod-meta.json', budget: 1e6});
    await shown.waitForFunction(() => window.shown);
    let dB = 0;
    for (let i = 0; i < 100 && dB <= LEAST; ++i) {
      await shown.waitForTimeout(200);
      dB = await psnr(sheet, coarse.near, await shown.screenshot({path: file('playcanvas-first.png')}));
    }
    const share = server.bytesOf('lod') / await bytesOf(file('lod'));
    console.log(`first picture: ${dB.toFixed(2)} dB against the coarsest level, after ${(100 * share).toFixed(1)} % of the bytes`);
    assert.ok(dB > LEAST);
    assert.ok(share < FIRST_SHARE, `${share}`);
    server.release();
    await shown.close();
  },
};

Object.assign(tests, {
  async 'Spark shows the .rad as render does, near and far'() {
    const ours = await render(file('lod', 'model.rad'), 'ours-rad', cameraFile);
    for (const [index, name] of ['near', 'far'].entries())
      assert.ok(await agreement(`${name}, Spark`, ours[name], (await spark(browser, name, index)).png) > LEAST_SPARK);
  },

  async 'Spark draws as many Gaussians as it may, and few of them look like all'() {
    const few = () => { document.getElementById('app').viewer.stage.splats.spark.lodSplatCount = 2000; };
    const all = await spark(browser, 'near', 0), some = await spark(browser, 'near', 0, few);
    console.log(`Gaussians drawn: ${all.splats}, and ${some.splats} of at most 2000`);
    assert.ok(some.splats <= 2000 && some.splats > 1000 && all.splats > 4 * some.splats);
    const dB = await agreement('near, 2000 in Spark', fine.near, some.png);
    assert.ok(dB < LEAST_SPARK && dB > 18);  // 5,000, the next level, have some 21
  },
});

const failed = await browser.runTests(tests);
await server.close();
finish(failed);
