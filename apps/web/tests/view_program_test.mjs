// SPDX-License-Identifier: Apache-2.0
// The viewer with the program's own server: a trained run, the same with pictures from the server,
// and a run that trains.
//   node view_program_test.mjs MODULES PROGRAM SCENE OUT CHROMIUM
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {mkdir, readFile, rm} from 'node:fs/promises';
import {join, resolve} from 'node:path';
import {Browser, findChromium, finish} from './browser.mjs';
import {colorsAt, psnr} from './pictures.mjs';
import {serveProgram} from './serve_program.mjs';

const STOPPED = 5; // the program's exit code after a signal
const [modules, program, scene, out] = process.argv.slice(2, 6).map(path => resolve(path)),
  chromium = findChromium(process.argv[6]);

const SETTINGS = [
  '--device',
  'cpu',
  '-q',
  '-r',
  '4',
  '--eval',
  '--set',
  'density.max_gaussians=5000',
];
const run = join(out, 'run'),
  renders = join(out, 'renders');
const gemsplat = (...words) =>
  execFileSync(program, words, {stdio: ['ignore', 'pipe', 'inherit']}).toString();

const serve = (...words) => serveProgram(program, ...words);
const serveRun = (name, ...words) =>
  serve(
    'train',
    scene,
    '-o',
    join(out, name),
    '--viewer',
    '--viewer-port',
    '0',
    ...words,
    ...SETTINGS.filter(word => word !== '-q'),
  );
const ready = page =>
  page.waitForFunction(() =>
    gemsplatViewer.ready.then(() => gemsplatViewer.settled()).then(() => true),
  );
const settled = page => page.waitForFunction(() => gemsplatViewer.settled().then(() => true));
const state = page => page.evaluate(() => gemsplatViewer.state());
const shot = (page, name) => page.screenshot({path: join(out, `${name}.png`)});

// The page at the size of camera `index`, without interface, against the program's own picture of
// it.
async function agreement(browser, url, index) {
  const {cameras} = await (await fetch(`${url}scene.json`)).json(),
    {name, width, height} = cameras[index];
  const page = await browser.openServer(url, {at: `c=${index}&ui=0`, width, height});
  await ready(page);
  const dB = await psnr(
    page,
    await page.screenshot(),
    await readFile(join(renders, name.replace(/\.[^.]*$/, '.png'))),
  );
  await page.close();
  return dB;
}

const tests = {
  async 'a trained run: its picture is that of render, its cameras have their photos'(browser) {
    const server = await serve('view', run, '--no-open', '--port', '0');
    for (const index of [1, 20]) {
      const dB = await agreement(browser, server.url, index);
      assert.ok(dB > 45, `camera ${index}: ${dB} dB`);
    }
    const page = await browser.openServer(server.url, {at: 'camera=0'});
    await ready(page);
    const results = JSON.parse(await readFile(join(run, 'results.json'), 'utf8'));
    assert.equal((await state(page)).gaussians, results.num_gaussians);
    await page.getByRole('button', {name: 'Slider'}).click();
    await page.waitForFunction(() => document.querySelector('.photo').naturalWidth > 0);
    await shot(page, 'program-slider');
    await page.keyboard.press('ArrowRight');
    assert.equal((await state(page)).camera, 1);
    await page.close();
    assert.equal(await server.end(), 0);
  },

  async 'pictures from the server are those of render'(browser) {
    const server = await serve(
      'view',
      run,
      '--remote',
      '--device',
      'cpu',
      '--no-open',
      '--port',
      '0',
    );
    const dB = await agreement(browser, server.url, 1);
    assert.ok(dB > 32, `${dB} dB`); // less than of the other: JPEG
    const page = await browser.openServer(server.url, {at: 'camera=0'});
    await ready(page);
    await page.keyboard.press('2');
    await settled(page);
    await shot(page, 'program-depth');
    await page.close();
    assert.equal(await server.end(), 0);
  },

  async 'a run that trains is shown while it does, ever newer'(browser) {
    const server = await serveRun('live', '-i', '30000'); // longer than anybody looks
    const page = await browser.openServer(server.url, {at: 'camera=0'});
    await page.waitForFunction(() => window.gemsplatViewer?.state()?.version >= 1);
    const {version} = await state(page);
    await page.waitForFunction(() =>
      /Step\s*[1-9]/.test(document.querySelector('.training-body').innerText),
    );
    let brightest = 0;
    for (let i = 0; i < 100 && brightest <= 40; ++i) {
      // by and by: drawn by the CPU, it does not settle between snapshots
      await page.waitForTimeout(200);
      const [middle] = await colorsAt(page, await shot(page, 'program-live'), [[640, 450]]);
      brightest = Math.max(...middle);
    }
    assert.ok(brightest > 40, `nothing is drawn: ${brightest}`);
    await page.waitForFunction(seen => gemsplatViewer.state().version > seen, version);
    await page.close();
    assert.equal(await server.end(), STOPPED);
  },

  async 'the end of a run is shown until Ctrl-C'(browser) {
    const server = await serveRun('ended', '-i', '60', '--viewer-wait');
    const page = await browser.openServer(server.url, {at: 'camera=0'});
    let told;
    do {
      await page.waitForTimeout(200);
      told = await (await fetch(`${server.url}state.json`)).json();
    } while (!told.done);
    assert.equal(told.step, 60);
    await page.waitForFunction(
      newest => window.gemsplatViewer?.state()?.version === newest,
      told.version,
    );
    assert.match(await page.locator('.training-body').innerText(), /Training is done/);
    await page.close();
    assert.equal(await server.end(), 0);
  },
};

await rm(out, {recursive: true, force: true});
await mkdir(out, {recursive: true});
gemsplat('train', scene, '-o', run, '-i', '300', ...SETTINGS);
gemsplat('render', run, '-o', renders, '-q', '--device', 'cpu');
const browser = await Browser.start(modules, chromium, {server: true});
browser.context.setDefaultTimeout(60_000);
finish(await browser.runTests(tests), `screenshots: ${out}`);
