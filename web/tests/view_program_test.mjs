// SPDX-License-Identifier: Apache-2.0
// The viewer of the program itself, in a browser: a run's model with its cameras and photos against `gemsplat render`, the same
// by frames from the server, and a run while it goes on.
//   node view_program_test.mjs MODULES PROGRAM SCENE OUT CHROMIUM
import assert from 'node:assert/strict';
import {execFileSync, spawn} from 'node:child_process';
import {existsSync} from 'node:fs';
import {mkdir, readFile, rm, writeFile} from 'node:fs/promises';
import {join, resolve} from 'node:path';
import {Browser} from './browser.mjs';
import {psnr} from './psnr.mjs';

const SKIPPED = 77;  // as CTest is told
const LEAST_DB = 28;
const [modules, program, scene, out] = process.argv.slice(2, 6).map(path => resolve(path)), chromium = process.argv[6];
if (!chromium || !existsSync(chromium)) {
  console.log('skipped: no Chromium was found; install the package chromium');
  process.exit(SKIPPED);
}

const SHORT = ['--device', 'cpu', '-r', '8', '--set', 'train.log_every=10', '--set', 'density.max_gaussians=3000'];
const run = join(out, 'run');
const gemsplat = (...words) => execFileSync(program, words, {stdio: ['ignore', 'pipe', 'inherit']}).toString();

// Starts the program and resolves when it has said where it listens.
function started(...words) {
  const child = spawn(program, words, {stdio: ['ignore', 'pipe', 'pipe']});
  const ended = new Promise(resolve => child.on('close', resolve));
  let said = '';
  return new Promise((resolve, reject) => {
    const listen = chunk => {
      said += chunk;
      const [url] = said.match(/http:\/\/127\.0\.0\.1:\d+\/(?=\s)/) ?? [];
      if (url) resolve({url, ended, end() { child.kill('SIGINT'); return ended; }});
    };
    child.stdout.on('data', listen);
    child.stderr.on('data', listen);
    child.on('close', code => reject(new Error(`ended with ${code}: ${said}`)));
  });
}
const answer = async (server, path) => (await fetch(new URL(path, server.url))).json();

const nameOf = camera => camera.name.replace(/\.[^.]*$/, '');

// The page at a camera, at its size, without interface: its picture against render's.
async function agreement(browser, server, index) {
  const camera = (await answer(server, 'scene.json')).cameras[index];
  const page = await browser.openServer(server.url, {at: `c=${index}&ui=0`, width: camera.width, height: camera.height});
  await page.evaluate(() => gemsplatViewer.ready.then(() => gemsplatViewer.settled()));
  const picture = await page.screenshot();
  await writeFile(join(out, `page-${index}.png`), picture);
  const dB = await psnr(page, picture, await readFile(join(out, 'renders', `${nameOf(camera)}.png`)));
  await page.close();
  return dB;
}

const tests = {
  async 'a run is shown as render shows it, with its cameras and photos'(browser) {
    const server = await started('view', run, '--no-open', '--port', '0');
    const {cameras} = await answer(server, 'scene.json');
    assert.ok(cameras.some(({split}) => split === 'test') && cameras.some(({split}) => split === 'train'));
    assert.ok(cameras.every(({photo}) => photo));
    for (const index of [0, Math.floor(cameras.length / 2)]) {
      const dB = await agreement(browser, server, index);
      console.log(`        ${cameras[index].name}: ${dB.toFixed(2)} dB`);
      assert.ok(dB >= LEAST_DB, `${cameras[index].name}: ${dB} dB`);
    }
    const page = await browser.openServer(server.url);
    await page.evaluate(() => gemsplatViewer.ready.then(() => gemsplatViewer.settled()));
    await page.screenshot({path: join(out, 'file.png')});
    await page.close();
    assert.equal(await server.end(), 0);
  },

  async 'so it is by frames that the server renders'(browser) {
    const server = await started('view', run, '--remote', '--device', 'cpu', '--no-open', '--port', '0');
    const dB = await agreement(browser, server, 0);
    console.log(`        ${dB.toFixed(2)} dB`);
    assert.ok(dB >= LEAST_DB, `${dB} dB`);
    assert.equal(await server.end(), 0);
  },

  async 'a run that goes on shows snapshots, its step and its end'(browser) {
    const server = await started('train', scene, '-o', join(out, 'live'), ...SHORT, '-i', '600', '--eval', '--viewer', '--viewer-port', '0', '--viewer-wait');
    const page = await browser.openServer(server.url);
    const version = () => page.evaluate(() => gemsplatViewer.ready.then(() => gemsplatViewer.state().version));
    await page.waitForFunction(() => window.gemsplatViewer?.state().version >= 1, null, {timeout: 120_000});
    const first = await version();
    let state;
    do {
      await page.waitForTimeout(500);
      state = await answer(server, 'state.json');
    } while (!state.done);
    assert.equal(state.step, 600);
    assert.ok(state.version > first, `version ${state.version} after ${first}`);
    await page.waitForFunction(newest => gemsplatViewer.state().version === newest, state.version);
    await page.screenshot({path: join(out, 'live.png')});
    await page.close();
    assert.equal(await server.end(), 0);
  },
};

await rm(out, {recursive: true, force: true});
await mkdir(out, {recursive: true});
gemsplat('train', scene, '-o', run, '-q', '--eval', '-i', '200', ...SHORT);
gemsplat('render', run, '-o', join(out, 'renders'), '-q', '--device', 'cpu');
const browser = await Browser.start(modules, chromium, {server: true});
browser.context.setDefaultTimeout(120_000);
let failed = 0;
for (const [name, test] of Object.entries(tests)) {
  try {
    await test(browser);
    assert.deepEqual(browser.failures, []);
    console.log(`ok      ${name}`);
  } catch (error) {
    ++failed;
    browser.failures.length = 0;
    console.log(`FAILED  ${name}\n${error.stack}`);
  }
}
await browser.close();
console.log(`${failed ? `${failed} failed` : 'all passed'}; screenshots: ${out}`);
process.exit(failed ? 1 : 0);
