// SPDX-License-Identifier: Apache-2.0
// The viewer plays a model that moves: its picture at two times is that of `gemsplat render --time`,
// also after looping and scrubbing back; the controls; frames of the server.
//   node view_time_test.mjs MODULES PROGRAM OUT CHROMIUM [PYTHON]
// tests/interop/gs4d_test.py makes the model.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {mkdir, readFile, rm, writeFile} from 'node:fs/promises';
import {join, resolve} from 'node:path';
import {fileURLToPath} from 'node:url';
import {Browser, findChromium} from './browser.mjs';
import {psnr} from './pictures.mjs';
import {serveProgram} from './serve_program.mjs';

const [modules, program, out] = process.argv.slice(2, 5).map(path => resolve(path)),
  chromium = findChromium(process.argv[5]),
  python = process.argv[6] ?? 'python3';
const WIDTH = 320,
  HEIGHT = 240;
const LEAST = 45; // dB between the page and `gemsplat render`
const SAME = 100; // dB of equal pictures, or more
const TIMES = [0.25, 0.7];
const MAKER = fileURLToPath(new URL('../../../tests/interop/gs4d_test.py', import.meta.url));
const camera = {
  id: 0,
  img_name: 'front',
  width: WIDTH,
  height: HEIGHT,
  fx: 260,
  fy: 260,
  position: [0, 0, -4],
  rotation: [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
};

const gemsplat = (...words) =>
  execFileSync(program, words, {stdio: ['ignore', 'pipe', 'inherit']}).toString();
await rm(out, {recursive: true, force: true});
await mkdir(out, {recursive: true});
const cameras = join(out, 'cameras.json'),
  model = join(out, 'model.ply'),
  file = join(out, 'model.gs4d');
await writeFile(cameras, JSON.stringify([camera]));
execFileSync(python, [MAKER, '--make', model]);
gemsplat('export', model, file, '--no-measure', '-q', '--duration', '4');
async function rendersOf(model, name) {
  const renders = {};
  for (const time of TIMES) {
    const folder = join(out, `${name}-${time}`);
    gemsplat(
      'render',
      model,
      '--cameras',
      cameras,
      '-r',
      '1',
      '-o',
      folder,
      '-q',
      '--device',
      'cpu',
      '--time',
      String(time),
    );
    renders[time] = await readFile(join(folder, 'front.png'));
  }
  return renders;
}
const renders = await rendersOf(file, 'render');

const serve = (...words) =>
  serveProgram(program, 'view', ...words, '--cameras', cameras, '--no-open', '--port', '0');
const state = page => page.evaluate(() => gemsplatViewer.state());
const settled = page =>
  page.waitForFunction(() =>
    gemsplatViewer.ready.then(() => gemsplatViewer.settled()).then(() => true),
  );
const at = async (page, time) => {
  await page.evaluate(time => gemsplatViewer.setTime(time), time);
  await settled(page);
  return page.screenshot();
};
const bare = {at: 'c=0&ui=0', width: WIDTH, height: HEIGHT};

async function agrees(page, time, name, least = LEAST) {
  const picture = await at(page, time);
  await writeFile(join(out, `${name}-${time}.png`), picture);
  const dB = await psnr(page, picture, renders[time]);
  console.log(`  ${name}, time ${time}: ${dB.toFixed(2)} dB`);
  assert.ok(dB > least, `${name} at ${time}: ${dB} dB`);
  return picture;
}

const tests = {
  async 'the picture of each time is that of render, and the same after a loop and back'(browser) {
    const server = await serve(model); // a PLY: the program makes a .gs4d of it
    const page = await browser.openServer(server.url, bare);
    await settled(page);
    const first = await agrees(page, TIMES[0], 'page'),
      second = await agrees(page, TIMES[1], 'page');
    assert.ok((await psnr(page, first, second)) < 35, 'the two times look alike');
    const before = (await state(page)).time;
    await page.evaluate(() => gemsplatViewer.setTime(0.97));
    await page.evaluate(() => gemsplatViewer.play(true));
    await page.waitForFunction(() => gemsplatViewer.state().time < 0.5); // it has looped
    await page.evaluate(() => gemsplatViewer.play(false));
    assert.notEqual((await state(page)).time, before);
    assert.ok(
      (await psnr(page, await at(page, TIMES[0]), first)) >= SAME,
      'another picture after a loop',
    );
    await at(page, TIMES[1]);
    for (const time of [0, 1, TIMES[0]])
      await page.evaluate(time => gemsplatViewer.setTime(time), time); // without waiting
    assert.ok(
      (await psnr(page, await at(page, TIMES[0]), first)) >= SAME,
      'another picture after scrubbing back',
    );
    await page.close();
    server.end();
  },

  async 'bar and keys: play, pause, scrub, loop, speed'(browser) {
    const server = await serve(file);
    const page = await browser.openServer(server.url, {at: 'c=0', width: 1000, height: 640});
    await settled(page);
    assert.deepEqual(
      await state(page).then(({time, isPlaying, loaded}) => ({time, isPlaying, loaded})),
      {time: 0, isPlaying: false, loaded: 1},
    );
    assert.equal(await page.locator('.time-clock').textContent(), '0.00 / 4.0 s');
    await page.keyboard.press('Space');
    await page.waitForFunction(() => gemsplatViewer.state().time > 0.02);
    await page.getByRole('button', {name: 'pause (Space)'}).click();
    const {time} = await state(page);
    await page.waitForTimeout(300);
    assert.equal((await state(page)).time, time);
    await page.locator('.time-range').fill('500');
    assert.equal((await state(page)).time, 0.5);
    await page.keyboard.press('.');
    assert.ok(Math.abs((await state(page)).time - 0.51) < 1e-9);
    await page.keyboard.press(',');
    await page.keyboard.press(']');
    assert.equal(await page.locator('.time-speed').inputValue(), '2');
    await page.keyboard.press('j');
    await page.keyboard.press('End');
    assert.equal((await state(page)).time, 1);
    await page.keyboard.press('Home');
    await page.evaluate(() => gemsplatViewer.setTime(0.9));
    await page.keyboard.press('Space');
    await page.waitForFunction(() => !gemsplatViewer.state().isPlaying); // without the loop it ends
    assert.equal((await state(page)).time, 1);
    await settled(page);
    await page.screenshot({path: join(out, 'bar.png')});
    await page.close();
    server.end();
  },

  async '--time: it begins there, and stands still'(browser) {
    const server = await serve(file, '--time', String(TIMES[0]));
    const page = await browser.openServer(server.url, {...bare, reducedMotion: 'no-preference'});
    await settled(page);
    assert.deepEqual(await state(page).then(({time, isPlaying}) => ({time, isPlaying})), {
      time: TIMES[0],
      isPlaying: false,
    });
    assert.ok((await psnr(page, await page.screenshot(), renders[TIMES[0]])) > LEAST);
    await page.close();
    server.end();
  },

  async 'it plays at once, unless the user wants little motion'(browser) {
    const server = await serve(file);
    const page = await browser.openServer(server.url, {...bare, reducedMotion: 'no-preference'});
    await page.waitForFunction(() =>
      gemsplatViewer.ready.then(() => gemsplatViewer.state().time > 0.05),
    );
    assert.equal((await state(page)).isPlaying, true);
    await page.close();
    server.end();
  },

  // Three chunks, of which the first one shows the beginning of the scene.
  async 'it plays while the rest of the model comes, and never beyond what is there'(browser) {
    const large = join(out, 'large.ply'),
      chunks = join(out, 'large.gs4d');
    execFileSync(python, [MAKER, '--make', large, '70000', '0.04']);
    gemsplat('export', large, chunks, '--no-measure', '-q', '--duration', '4');
    const server = await serve(chunks);
    const page = await browser.openServer(server.url, {
      ...bare,
      reducedMotion: 'no-preference',
      bytesPerSecond: 250_000,
    });
    const seen = await page.evaluate(async () => {
      const seen = [];
      for (let last = 0; last < 1;) {
        await new Promise(requestAnimationFrame);
        const {time, loaded} = globalThis.gemsplatViewer?.state() ?? {};
        if (!loaded) continue;
        seen.push([time, loaded]);
        last = loaded;
      }
      return seen;
    });
    const early = seen.filter(([, loaded]) => loaded < 1);
    assert.ok(
      early.length >= 2,
      `${seen.length} frames, ${early.length} of them before the model was complete`,
    );
    for (const [time, loaded] of early)
      assert.ok(time <= loaded, `time ${time} was shown, and ${loaded} was there`);
    assert.ok(
      early.some(([time]) => time > 0.05),
      'it did not play before the model was complete',
    );
    await page.evaluate(() => gemsplatViewer.play(false));
    await settled(page);
    assert.equal((await state(page)).gaussians, 70000);
    await page.close();
    server.end();
  },

  async 'frames of the server have the time, too'(browser) {
    const server = await serve(file, '--remote', '--device', 'cpu');
    const page = await browser.openServer(server.url, bare);
    await settled(page);
    for (const time of TIMES) await agrees(page, time, 'remote', 33); // JPEG
    await page.close();
    const {status} = await fetch(
      `${server.url}frame?w=16&h=16&fx=9&fy=9&cx=8&cy=8&m=1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1&t=1.5`,
    );
    assert.equal(status, 400);
    server.end();
  },
};

const browser = await Browser.start(modules, chromium, {server: true});
browser.context.setDefaultTimeout(120_000);
let failed = 0;
for (const [name, test] of Object.entries(tests)) {
  try {
    await test(browser);
    console.log(`ok: ${name}`);
  } catch (error) {
    ++failed;
    console.log(`FAILED: ${name}\n${error.stack}`);
  }
}
await browser.close();
for (const failure of browser.failures) console.log(failure);
process.exit(failed || browser.failures.length ? 1 : 0);
