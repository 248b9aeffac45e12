// SPDX-License-Identifier: Apache-2.0
// Reports as a browser shows them: trains the bundled program's smallest runs, opens what they
// wrote with no network, clicks, drags, types, and keeps screenshots.
//   node report_test.mjs MODULES PROGRAM SCENE OUT CHROMIUM
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {existsSync} from 'node:fs';
import {mkdir, readFile, rm, stat, writeFile} from 'node:fs/promises';
import {join, resolve} from 'node:path';
import {Browser, findChromium, finish} from './browser.mjs';

const [modules, program, scene, out] = process.argv.slice(2, 6).map(path => resolve(path));
const chromium = findChromium(process.argv[6]);
const MOST_BYTES = 16 * 2 ** 20; // of a report: docs/guide/report.md

const SETTINGS = [
  '--device',
  'cpu',
  '-q',
  '-r',
  '8',
  '--set',
  'train.log_every=5',
  '--set',
  'density.max_gaussians=3000',
];
const gemsplat = (...words) =>
  execFileSync(program, words, {stdio: ['ignore', 'pipe', 'inherit']}).toString();

async function makeRuns() {
  await rm(out, {recursive: true, force: true});
  await mkdir(out, {recursive: true});
  gemsplat(
    'train',
    scene,
    '-o',
    join(out, 'run'),
    '--eval',
    '-i',
    '200',
    '--test-steps',
    '100,150',
    ...SETTINGS,
  );
  gemsplat('train', scene, '-o', join(out, 'short'), '-i', '4', ...SETTINGS);
  await writeFile(
    join(out, 'two.toml'),
    `output = "two"
scenes = [${JSON.stringify(scene)}, {path = ${JSON.stringify(scene)}, name = "again", set = {"dataset.resolution" = 16}}]
seeds = [1, 2]
baseline = "usual"
set = {dataset = {eval = true, resolution = 8}, train = {iterations = 60, log_every = 10, test_steps = [30], device = "cpu"}, density = {max_gaussians = 3000}}
configs = [{name = "usual"}, {name = "ssim", set = {loss.lambda_dssim = 0.4}}]
`,
  );
  gemsplat('experiment', join(out, 'two.toml'), '-q');
}

async function shot(page, name) {
  await page.evaluate(() => {
    document.activeElement?.blur();
    scrollTo(0, 0);
  });
  await page.screenshot({path: join(out, `${name}.png`), fullPage: true});
}
const share = page =>
  page.locator('.stage').evaluate(stage => parseFloat(stage.style.getPropertyValue('--share')));
const widthFits = page =>
  page.evaluate(() => document.documentElement.scrollWidth <= window.innerWidth);

const tests = {
  async 'a run shows its figures and draws its charts'(browser) {
    const page = await browser.open(join(out, 'run/report.html'));
    const results = JSON.parse(await readFile(join(out, 'run/results.json'), 'utf8'));
    const tiles = await page.locator('.tiles').innerText();
    assert.ok(tiles.includes(results.test.psnr.toFixed(2)), tiles);
    for (const key of ['ssim', 'flip'])
      assert.ok(tiles.includes(results.test[key].toFixed(4)), tiles);
    assert.equal(await page.locator('h1').innerText(), 'courtyard');
    for (const title of [
      'Loss',
      'PSNR',
      'SSIM',
      'Gaussians',
      'Time per stage',
      'Memory',
      'Speed',
      'Opacity',
      'Scale',
    ])
      assert.equal(await page.locator(`[data-chart="${title}"] canvas`).count(), 1, title);
    await shot(page, 'run-desktop-light');
    await page.close();
  },

  async 'a mesh is shown beside photos'(browser) {
    const mesh = join(out, 'run/mesh.glb'),
      file = join(out, 'mesh.html');
    gemsplat('mesh', join(out, 'run'), '--collision', '--voxel', '0.1', '-o', mesh, '-q');
    gemsplat('report', join(out, 'run'), '-o', file);
    await rm(mesh);
    const page = await browser.open(file);
    assert.match(await page.locator('#mesh p').innerText(), /triangles.* dB, SSIM 0\.\d+/);
    const widths = await page.evaluate(() =>
      [...document.querySelectorAll('#mesh img')].map(image => image.naturalWidth),
    );
    assert.equal(widths.length, 4);
    assert.ok(widths.every(width => width > 0));
    await page.close();
  },

  async 'a chart tells values under the cursor, and switches its scales'(browser) {
    const page = await browser.open(join(out, 'run/report.html'));
    const loss = page.locator('[data-chart="Loss"]');
    await loss.locator('.u-over').hover();
    await loss.locator('.tip').waitFor();
    const tip = await loss.locator('.tip').innerText();
    assert.match(tip, /step \d+/);
    assert.match(tip, /running mean\s+0\.\d+/);
    const canvas = () => loss.locator('canvas').evaluate(node => node.toDataURL());
    await page.mouse.move(0, 0);
    const log = await canvas();
    await loss.getByRole('button', {name: 'linear'}).click();
    assert.notEqual(await canvas(), log);
    await page.getByRole('button', {name: 'time', exact: true}).click();
    await page.waitForTimeout(200);
    assert.equal(await page.locator('[data-chart="Loss"] canvas').count(), 1);
    await page.locator('[data-chart="PSNR"] .u-over').hover();
    assert.match(
      await page.locator('[data-chart="PSNR"] .tip').innerText(),
      /step \d+ · .*s\s+PSNR\s+\d+\.\d\d dB/,
    );
    await page.close();
  },

  async 'the slider follows mouse and keys, and the view and pictures can be chosen'(browser) {
    const page = await browser.open(join(out, 'run/report.html'));
    const stage = page.locator('.stage');
    await stage.scrollIntoViewIfNeeded();
    const box = await stage.boundingBox();
    await page.mouse.click(box.x + 0.25 * box.width, box.y + box.height / 2);
    assert.ok(Math.abs((await share(page)) - 25) < 1);
    await page.mouse.down();
    await page.mouse.move(box.x + 0.8 * box.width, box.y + box.height / 2, {steps: 5});
    await page.mouse.up();
    assert.ok(Math.abs((await share(page)) - 80) < 1);
    await page.keyboard.press('ArrowLeft');
    assert.ok(Math.abs((await share(page)) - 79) < 1);

    const left = page.locator('.stage .front');
    assert.match(await left.getAttribute('alt'), /^photo of /);
    await page.getByRole('button', {name: 'render | error'}).click();
    assert.match(await left.getAttribute('alt'), /^render of /);
    await page.getByRole('button', {name: 'photo | FLIP'}).click();
    const flip = page.locator('.stage .back');
    assert.match(await flip.getAttribute('alt'), /^FLIP of /);
    assert.ok((await flip.evaluate(image => image.decode().then(() => image.naturalWidth))) > 0);
    const name = await page.locator('.view-name').innerText(),
      source = await left.getAttribute('src');
    await page.getByRole('button', {name: 'next view'}).click();
    assert.notEqual(await page.locator('.view-name').innerText(), name);
    assert.notEqual(await left.getAttribute('src'), source);
    const loaded = await left.evaluate(image => image.decode().then(() => image.naturalWidth));
    assert.ok(loaded > 0);
    await page.locator('.thumb').first().click();
    assert.equal(await page.locator('.view-name').innerText(), name);
    await page.getByText('metrics of all').click();
    const view = JSON.parse(await readFile(join(out, 'run/per_view.json'), 'utf8')).test[name];
    const table = await page.locator('.all-views table').innerText();
    for (const key of ['ssim', 'flip'])
      assert.ok(table.includes(view[key].toFixed(4)), `${key}: ${table}`);
    await page.locator('.all-views .link').last().click();
    assert.equal(
      await page.locator('.all-views .link').last().innerText(),
      await page.locator('.view-name').innerText(),
    );
    await page.close();
  },

  async 'a phone has room for all of it, and its slider follows a finger'(browser) {
    for (const colorScheme of ['light', 'dark']) {
      const page = await browser.open(join(out, 'run/report.html'), {
        width: 390,
        height: 844,
        colorScheme,
      });
      assert.ok(await widthFits(page), 'the page is wider than a phone');
      const stage = page.locator('.stage');
      await stage.scrollIntoViewIfNeeded();
      const box = await stage.boundingBox();
      const session = await browser.context.newCDPSession(page);
      const point = at => [{x: box.x + at * box.width, y: box.y + box.height / 2}];
      await session.send('Emulation.setTouchEmulationEnabled', {enabled: true});
      await session.send('Input.dispatchTouchEvent', {type: 'touchStart', touchPoints: point(0.5)});
      for (const at of [0.45, 0.4, 0.35, 0.3])
        await session.send('Input.dispatchTouchEvent', {type: 'touchMove', touchPoints: point(at)});
      await session.send('Input.dispatchTouchEvent', {type: 'touchEnd', touchPoints: []});
      assert.ok(Math.abs((await share(page)) - 30) < 2, String(await share(page)));
      await shot(page, `run-phone-${colorScheme}`);
      await page.close();
    }
  },

  async 'dark is dark'(browser) {
    for (const [name, file] of [
      ['run', 'run/report.html'],
      ['experiment', 'two/report.html'],
    ]) {
      const page = await browser.open(join(out, file), {colorScheme: 'dark'});
      const ground = await page.evaluate(() => getComputedStyle(document.body).backgroundColor);
      assert.ok(
        ground.match(/\d+/g).every(value => Number(value) < 40),
        ground,
      );
      await shot(page, `${name}-desktop-dark`);
      await page.close();
    }
  },

  async 'a run too short for curves, without test views, has a report all the same'(browser) {
    const page = await browser.open(join(out, 'short/report.html'));
    assert.equal(await page.getByRole('heading', {name: 'Training views'}).count(), 1);
    assert.equal(await page.locator('.stage').count(), 1);
    assert.match(await page.locator('#training').innerText(), /No curves/);
    await shot(page, 'short-desktop-light');
    await page.close();
  },

  async 'an experiment shows means, every run, curves by config, and leads to the runs'(browser) {
    const page = await browser.open(join(out, 'two/report.html'));
    const results = JSON.parse(await readFile(join(out, 'two/results.json'), 'utf8'));
    const {mean, standard_deviation: deviation} = results.summary[1].psnr;
    const figures = (await page.locator('#results table').allInnerTexts()).join('\n');
    assert.ok(figures.includes(`${mean.toFixed(2)} ± ${deviation.toFixed(2)}`), figures);
    const [gap] = results.differences,
      over = results.scene_means[0].flip,
      differences = page.locator('[aria-label="differences to the baseline"]');
    assert.equal(await differences.locator('tbody tr').count(), 3);
    assert.ok(
      (await differences.innerText()).includes(
        `${Math.abs(gap.psnr.mean).toFixed(2)} ± ${gap.psnr.standard_error.toFixed(2)}`,
      ),
    );
    assert.ok(
      figures.includes(`${over.mean.toFixed(4)} ± ${over.standard_deviation.toFixed(4)}`),
      figures,
    );
    assert.equal(await page.locator('#results circle').count(), 8);
    assert.equal(await page.locator('#curves canvas').count(), 2);
    await page.locator('#curves').getByRole('button', {name: 'PSNR'}).click();
    await page.waitForTimeout(200);
    assert.equal(await page.locator('#curves canvas').count(), 2);
    await page.locator('#results').getByRole('button', {name: 'SSIM', exact: true}).click();
    assert.match(await page.locator('#results figcaption').first().innerText(), /SSIM/);
    const scenes = page.locator('#scenes tbody tr'),
      configs = await page.locator('#configs').innerText();
    assert.equal(await scenes.count(), 2);
    assert.ok(
      (await scenes.nth(1).innerText()).includes('dataset.resolution = 16'),
      await scenes.nth(1).innerText(),
    );
    assert.ok(!(await scenes.nth(0).innerText()).includes('dataset.resolution'));
    assert.ok(configs.includes('dataset.resolution = 8') && !configs.includes('= 16'), configs); // what the config says
    assert.ok(
      (await page.locator('#provenance').innerText()).includes(
        results.provenance.command.join(' '),
      ),
    );
    await shot(page, 'experiment-desktop-light');
    const links = await page.locator('#runs a').evaluateAll(list => list.map(link => link.href));
    assert.equal(links.length, 8);
    for (const link of links) assert.ok(existsSync(new URL(link)), link);
    await page.close();
    const phone = await browser.open(join(out, 'two/report.html'), {width: 390, height: 844});
    assert.ok(await widthFits(phone), 'the page is wider than a phone');
    await shot(phone, 'experiment-phone-light');
    await phone.close();
  },

  async 'names cannot become markup or script'(browser) {
    const evil = '</script><script>alert(1)</script><img src=x onerror=alert(2)><!--<script>';
    const copy = join(out, 'evil');
    execFileSync('cp', ['-r', join(out, 'run'), copy]);
    const change = async (file, edit) =>
      writeFile(join(copy, file), edit(await readFile(join(copy, file), 'utf8')));
    await change('config.toml', text =>
      text.replace(
        /^source = .*$/m,
        `source = ${JSON.stringify(`/tmp/${evil.replaceAll('/', '\u2215')}`)}`,
      ),
    );
    await change('results.json', text =>
      JSON.stringify({...JSON.parse(text), device: evil, commit: evil}),
    );
    const split = JSON.parse(await readFile(join(copy, 'split.json'), 'utf8'));
    const old = split.test[0];
    await change('split.json', text => text.replace(JSON.stringify(old), JSON.stringify(evil)));
    await change('per_view.json', text => text.replace(JSON.stringify(old), JSON.stringify(evil)));
    gemsplat('report', copy);
    const page = await browser.open(join(copy, 'report.html'));
    assert.equal(await page.locator('.view-name').innerText(), evil);
    assert.equal(await page.locator('main script').count(), 0);
    assert.ok((await page.locator('#provenance').innerText()).includes(evil));
    await page.close();
  },

  async 'reports stay below the size that the documentation states'() {
    for (const file of ['run/report.html', 'two/report.html'])
      assert.ok((await stat(join(out, file))).size < MOST_BYTES, file);
  },
};

await makeRuns();
const browser = await Browser.start(modules, chromium);
browser.context.setDefaultTimeout(10_000);
finish(await browser.runTests(tests), `screenshots: ${out}`);
