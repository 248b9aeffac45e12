// SPDX-License-Identifier: Apache-2.0
// The viewer's tools against the program: what the page prints and saves is run, and its depth,
// normals, PSNR and colors are compared with those of `gemsplat render` and `eval`.
//   node view_commands_test.mjs MODULES PROGRAM SCENE OUT CHROMIUM
import assert from 'node:assert/strict';
import {execFileSync, execSync} from 'node:child_process';
import {mkdir, readFile, rm, writeFile} from 'node:fs/promises';
import {join, resolve} from 'node:path';
import {Browser, findChromium, finish} from './browser.mjs';
import {psnr} from './pictures.mjs';
import {serveProgram} from './serve_program.mjs';

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
  '--set',
  'photometric.model=gains',
  '--set',
  'photometric.rate=0.02',
];
const run = join(out, 'run');
const gemsplat = (...words) =>
  execFileSync(program, words, {cwd: out, stdio: ['ignore', 'pipe', 'inherit']}).toString();
const render = (folder, ...words) =>
  gemsplat('render', run, '-o', join(out, folder), '-q', '--device', 'cpu', ...words);
const ready = page =>
  page.waitForFunction(() =>
    gemsplatViewer.ready.then(() => gemsplatViewer.settled()).then(() => true),
  );
const settled = page => page.waitForFunction(() => gemsplatViewer.settled().then(() => true));
const bare = name => name.replace(/\.[^.]*$/, '');
const camerasOf = async server => (await (await fetch(`${server.url}scene.json`)).json()).cameras;
const tool = async (page, title) => {
  await page.keyboard.press('t');
  await page
    .getByRole('group', {name: 'tool', exact: true})
    .getByRole('button', {name: title})
    .click();
};

const tests = {
  async 'depth and normals are those of render'(browser, server) {
    const cameras = await camerasOf(server);
    for (const index of [1, 20]) {
      const {name, width, height} = cameras[index];
      const page = await browser.openServer(server.url, {
        at: `c=${index}&ui=0&show=depth`,
        width,
        height,
      });
      await ready(page);
      const depth = await page.screenshot();
      const [far, near] = await page.evaluate(() =>
        app.viewer.stage.splats.surface.uniforms.range.value.toArray(),
      );
      await page.keyboard.press('3');
      await settled(page);
      const normals = await page.screenshot();
      await rm(join(out, 'surface'), {recursive: true, force: true});
      render(
        'surface',
        '--write',
        'depth,normal',
        '--normal-space',
        'camera',
        '--depth-range',
        String(1 / near),
        String(1 / far),
      );
      const dB = await psnr(
        page,
        depth,
        await readFile(join(out, 'surface', `${bare(name)}.depth.png`)),
      );
      assert.ok(dB > 38, `depth of camera ${index}: ${dB} dB`);
      const dBOfNormals = await psnr(
        page,
        normals,
        await readFile(join(out, 'surface', `${bare(name)}.normal.png`)),
      );
      assert.ok(dBOfNormals > 25, `normals of camera ${index}: ${dBOfNormals} dB`);
      console.log(
        `        camera ${index}: depth ${dB.toFixed(1)} dB, normals ${dBOfNormals.toFixed(1)} dB`,
      );
      await page.close();
    }
  },

  async 'PSNR is that of the evaluation, up to the JPEG that the page gets'(browser, server) {
    const page = await browser.openServer(server.url, {at: 'camera=0'});
    await ready(page);
    const [{name}] = await camerasOf(server),
      found = [];
    await page.keyboard.press('m');
    await page.getByText(`${name}: `).waitFor();
    found.push(Number((await page.locator('.tool .said').innerText()).match(/: ([\d.]+) dB/)[1]));
    const evaluated = JSON.parse(await readFile(join(run, 'per_view.json'), 'utf8'));
    const wanted = findPsnr(evaluated, name);
    assert.ok(Math.abs(found[0] - wanted) < 0.15, `${found[0]} instead of ${wanted}`);
    await page.close();
  },

  async 'colors as a photo are those of render --like, in the page and from the server'(
    browser,
    server,
  ) {
    render('like', '--like', 'each');
    const cameras = await camerasOf(server),
      remote = await serveProgram(
        program,
        'view',
        run,
        '--remote',
        '--device',
        'cpu',
        '--no-open',
        '--port',
        '0',
      );
    for (const [index, from] of [
      [1, server],
      [20, server],
      [1, remote],
    ]) {
      const {name, width, height} = cameras[index],
        wanted = await readFile(join(out, 'like', `${bare(name)}.png`));
      const page = await browser.openServer(from.url, {
        at: `c=${index}&ui=0&colors=photo`,
        width,
        height,
      });
      await ready(page);
      const dB = await psnr(page, await page.screenshot(), wanted);
      await page.keyboard.press('4');
      await settled(page);
      const neutral = await psnr(page, await page.screenshot(), wanted);
      assert.ok(
        dB > (from === remote ? 30 : 50) && dB > neutral + 6,
        `camera ${index}: ${dB} dB, neutral ${neutral} dB`,
      );
      await page.close();
    }
    assert.equal(await remote.end(), 0);
  },

  async 'the command of a crop leaves as many Gaussians as the page says'(browser, server) {
    const page = await browser.openServer(server.url, {at: 'camera=0'});
    await ready(page);
    await tool(page, 'Crop');
    for (const shape of ['Box', 'Sphere']) {
      await page.getByRole('group', {name: 'shape'}).getByRole('button', {name: shape}).click();
      await page.waitForTimeout(600);
      const [, kept, all] = (await page.locator('.tool .said').innerText())
        .match(/([\d,]+) of ([\d,]+) Gaussians remain/)
        .map(text => Number(text.replaceAll(',', '')));
      assert.ok(kept > 50 && kept < all - 50, `${kept} of ${all}`);
      const command = (await page.locator('.tool .command').innerText()).replace(
        /^gemsplat/,
        `'${program}'`,
      );
      execSync(`${command} --force`, {cwd: out, stdio: ['ignore', 'ignore', 'inherit']});
      const {count} = JSON.parse(gemsplat('info', join(out, 'cropped.ply'), '--json'));
      assert.equal(count, kept);
    }
    await page.close();
  },

  async 'render follows the path that the page has previewed'(browser, server) {
    const page = await browser.openServer(server.url, {at: 'camera=0'});
    await ready(page);
    await tool(page, 'Path');
    for (const index of [0, 9, 20, 5]) {
      await page.evaluate(index => gemsplatViewer.setCamera(index), index);
      await page.getByRole('button', {name: 'Add this view'}).click();
    }
    for (const [isClosed, pace] of [
      [false, 'even'],
      [true, 'even'],
      [false, 'keys'],
    ]) {
      await page.evaluate(
        ([isClosed, pace]) => {
          Object.assign(app.viewer.tools.path, {isClosed, pace});
          app.viewer.tools.path.changed();
        },
        [isClosed, pace],
      );
      const [file] = await Promise.all([
        page.waitForEvent('download'),
        page.getByRole('button', {name: 'Save path.json'}).click(),
      ]);
      await file.saveAs(join(out, 'path.json'));
      const folder = `path-${pace}-${isClosed}`;
      render(folder, '--path', join(out, 'path.json'), '--frames', '7', '--size', '40x30');
      const cameras = JSON.parse(await readFile(join(out, folder, 'cameras.json'), 'utf8'));
      const shown = await page.evaluate(
        pace =>
          [...Array(7).keys()].map(i =>
            app.viewer.tools.path.spline
              .along(i / (app.viewer.tools.path.isClosed ? 7 : 6), pace)
              .position.toArray(),
          ),
        pace,
      );
      cameras.forEach(({position}, i) =>
        assert.ok(
          Math.hypot(...position.map((x, k) => x - shown[i][k])) < 2e-3,
          `${folder} frame ${i}: ${position} instead of ${shown[i]}`,
        ),
      );
    }
    await page.close();
  },
};

// The photos of the scene have one light, so that their gains are near 1. A tenth of its red more and of its blue less
// for each photo, in turns of three strengths, is more than a page and a renderer differ by.
async function exaggerateGains(file) {
  const looks = JSON.parse(await readFile(file, 'utf8'));
  for (const photos of [looks.photos, looks.held_out])
    Object.values(photos).forEach((photo, i) => {
      photo.log_gain_red += 0.1 * (1 + (i % 3));
      photo.log_gain_blue -= 0.1 * (1 + (i % 3));
    });
  await writeFile(file, JSON.stringify(looks));
}

// The PSNR of a view in per_view.json, wherever it stands there.
function findPsnr(json, name) {
  if (json && typeof json === 'object') {
    if ((json.name === name || json.name === bare(name)) && typeof json.psnr === 'number')
      return json.psnr;
    if (json[name]?.psnr ?? json[bare(name)]?.psnr)
      return json[name]?.psnr ?? json[bare(name)].psnr;
    for (const part of Object.values(json)) {
      const found = findPsnr(part, name);
      if (found) return found;
    }
  }
  return null;
}

await rm(out, {recursive: true, force: true});
await mkdir(out, {recursive: true});
gemsplat('train', scene, '-o', run, '-i', '300', ...SETTINGS);
await exaggerateGains(join(run, 'photometric.json'));
const server = await serveProgram(program, 'view', run, '--no-open', '--port', '0');
const browser = await Browser.start(modules, chromium, {server: true});
browser.context.setDefaultTimeout(60_000);
const failed = await browser.runTests(tests, {args: [server]});
await server.end();
finish(failed, `screenshots: ${out}`);
