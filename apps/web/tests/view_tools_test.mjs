// SPDX-License-Identifier: Apache-2.0
// The viewer's tools in a browser: screenshots, addresses, splats and points, measuring, PSNR, depth
// and normals. Software WebGL, no network beyond this machine.
//   node view_tools_test.mjs MODULES OUT CHROMIUM
import assert from 'node:assert/strict';
import {readFile} from 'node:fs/promises';
import {colorsAt, psnr} from './pictures.mjs';
import {
  PHOTO,
  assertInside,
  distance,
  isNear,
  ready,
  runAll,
  settled,
  shot,
  shown,
  state,
  windowPlace,
  withPhotos,
} from './view_page.mjs';
import {BLOBS, CAMERAS, plainPng, sceneFor, seenAt} from './view_scene.mjs';

const hash = page => page.evaluate(() => location.hash);
const sizeOf = png => [png.readUInt32BE(16), png.readUInt32BE(20)];
const tool = async (page, title) => {
  if (!(await page.locator('.panel.tools').isVisible())) await page.keyboard.press('t');
  await page
    .getByRole('group', {name: 'tool', exact: true})
    .getByRole('button', {name: title})
    .click();
};
const set = (page, name, value) =>
  page.evaluate(([name, value]) => app.viewer.switches.set(name, value), [name, value]);
const colorAt = async (page, place) => (await colorsAt(page, await page.screenshot(), [place]))[0];

async function downloaded(page, act) {
  const [file] = await Promise.all([page.waitForEvent('download'), act()]);
  return {name: file.suggestedFilename(), bytes: await readFile(await file.path())};
}

const tests = {
  async 'a screenshot is the picture alone, at the size of the window or twice that'(browser) {
    const page = await shown(browser, {}, {at: 'camera=0'});
    await ready(page);
    const place = await windowPlace(page, CAMERAS[0], BLOBS[1].at);
    const {name, bytes} = await downloaded(page, () => page.keyboard.press('k'));
    assert.equal(name, 'a_scene.png');
    assert.deepEqual(sizeOf(bytes), [1280, 900]);
    assert.ok(
      isNear(
        (await colorsAt(page, bytes, [place]))[0],
        BLOBS[1].color.map(c => 255 * c),
      ),
    );
    assert.deepEqual(
      (await colorsAt(page, bytes, [[1260, 20]]))[0],
      [0, 0, 0],
      'without the tools',
    );
    await tool(page, 'Picture');
    const twice = (
      await downloaded(page, () => page.getByRole('button', {name: 'PNG, twice as large'}).click())
    ).bytes;
    assert.deepEqual(sizeOf(twice), [2560, 1800]);
    assert.ok(
      isNear(
        (await colorsAt(page, twice, [place.map(x => 2 * x)]))[0],
        BLOBS[1].color.map(c => 255 * c),
      ),
    );
    await settled(page);
    assert.ok(
      isNear(
        await colorAt(page, place),
        BLOBS[1].color.map(c => 255 * c),
      ),
      'the canvas is as it was',
    );
    await page.close();
  },

  async 'a screenshot of pictures from the server asks for its pixels'(browser) {
    const frame = query => ({
      body: plainPng(Number(query.get('w')), Number(query.get('h')), [10, 120, 200]),
      milliseconds: 1,
    });
    const page = await shown(
      browser,
      {scene: sceneFor('remote', {device: 'cpu', model: {gaussians: 7}}), frame},
      {at: 'camera=0'},
    );
    await ready(page);
    await tool(page, 'Picture');
    const {bytes} = await downloaded(page, () =>
      page.getByRole('button', {name: 'PNG, twice as large'}).click(),
    );
    assert.deepEqual(sizeOf(bytes), [2560, 1800]);
    assert.ok(isNear((await colorsAt(page, bytes, [[1280, 900]]))[0], [10, 120, 200], 2));
    await page.close();
  },

  async 'the address holds the view and its switches, and opens it again'(browser) {
    const page = await shown(browser, {});
    await ready(page);
    await page.mouse.move(640, 450);
    await page.mouse.down();
    await page.mouse.move(760, 400, {steps: 6});
    await page.mouse.up();
    await page.mouse.move(5, 890); // on no frustum
    for (const [name, value] of [
      ['background', 'white'],
      ['scale', 0.5],
      ['frusta', true],
      ['navigation', 'fly'],
      ['show', 'normal'],
    ])
      await set(page, name, value);
    await page.waitForFunction(
      () => /p=.*show=normal/.test(location.hash) && /navigation=fly/.test(location.hash),
    );
    const closePanel = each => each.evaluate(() => app.viewer.panels.model.toggle(false)); // it has the speed of drawing
    await closePanel(page);
    const wanted = await state(page),
      picture = await page.screenshot();
    const again = await browser.openServer(page.server.url, {at: (await hash(page)).slice(1)});
    await ready(again);
    await closePanel(again);
    const found = await state(again);
    for (const part of ['position', 'quaternion', 'target'])
      assert.ok(distance(found[part], wanted[part]) < 1e-4, part);
    assert.deepEqual(await again.evaluate(() => app.viewer.switches.changes), [
      ['show', 'normal'],
      ['scale', '0.5'],
      ['background', 'white'],
      ['frusta', '1'],
      ['navigation', 'fly'],
    ]);
    await settled(again);
    assert.ok((await psnr(page, picture, await again.screenshot())) > 40);
    await page.close();
    for (const at of [
      'p=1,2&q=0,0,0,1&o=0,0,0&lens=1,1,1,1,1,1',
      'camera=77',
      'p=1,2,x&q=0,0,0,0&lens=',
      'show=blue&scale=-3&points=1e9&sh=<b>',
      'c=1e0&t=NaN&frusta=2',
    ]) {
      const odd = await shown(browser, {}, {at});
      await ready(odd);
      assert.deepEqual((await state(odd)).position, [0, 0, -4], `${at} leads to the first view`);
      assert.deepEqual(await odd.evaluate(() => app.viewer.switches.changes), [], at);
      await odd.close();
    }
    await again.close();
  },

  async 'Back and Forward lead through the places that were jumped to'(browser) {
    const page = await shown(browser, {}, {at: 'camera=0'});
    await ready(page);
    const arrive = async index =>
      page.waitForFunction(
        index => gemsplatViewer.state().camera === index && location.hash === `#camera=${index}`,
        index,
      );
    await arrive(0);
    await page.keyboard.press('ArrowRight');
    await arrive(1);
    await page.keyboard.press('ArrowRight');
    await arrive(2);
    await page.goBack();
    await arrive(1);
    await page.goBack();
    await arrive(0);
    await page.goForward();
    await arrive(1);
    await page.mouse.move(640, 450);
    await page.mouse.wheel(0, 100); // a movement by hand is no jump
    await page.waitForFunction(() => location.hash.startsWith('#p='));
    await page.goBack();
    await arrive(0);
    await page.close();
  },

  async 'splats can be smaller, or points of a size'(browser) {
    const page = await shown(browser, {}, {at: 'camera=0'});
    await ready(page);
    const [x, y] = await windowPlace(page, CAMERAS[0], BLOBS[1].at),
      [beside] = await windowPlace(page, CAMERAS[0], [1.2, 0, 0]);
    const lit = async place => (await colorAt(page, place))[0];
    assert.ok((await lit([beside, y])) > 40);
    await set(page, 'scale', 0.3);
    await settled(page);
    assert.ok((await lit([beside, y])) < 10 && (await lit([x, y])) > 150);
    await set(page, 'scale', 1);
    await page.keyboard.press('5');
    await page.keyboard.press('p');
    await page.getByRole('slider', {name: 'size of points'}).fill('8');
    await settled(page);
    assert.ok(
      isNear(
        await colorAt(page, [x + 2, y]),
        BLOBS[1].color.map(c => 255 * c),
        4,
      ),
      'a whole disc of its color',
    );
    assert.ok((await lit([x + 6, y])) < 5);
    await shot(page, 'points-light');
    await page.close();
  },

  async 'two clicks measure a distance, in meters where the scene knows them'(browser) {
    for (const [meters, words] of [
      [undefined, 'units'],
      [2.5, 'm'],
    ]) {
      const page = await shown(
        browser,
        {scene: sceneFor('file', {cameras: withPhotos, meters_per_unit: meters})},
        {at: 'camera=0', colorScheme: meters ? 'dark' : 'light'},
      );
      await ready(page);
      await tool(page, 'Measure');
      await page.mouse.click(...(await windowPlace(page, CAMERAS[0], BLOBS[0].at)));
      await page.mouse.click(...(await windowPlace(page, CAMERAS[0], BLOBS[1].at)));
      const [, value, unit] = (await page.locator('.tool .said').innerText()).match(
        /Distance: ([\d.]+) (\w+)/,
      );
      assert.equal(unit, words);
      assert.ok(Math.abs(value / (meters ?? 1) - 1) < 0.02, value);
      assert.equal(await page.locator('.measure-words').textContent(), `${value} ${unit}`);
      assert.equal((await state(page)).camera, 0, 'a click is for the tool');
      await shot(page, `measure-${meters ? 'dark' : 'light'}`);
      await page.mouse.click(640, 120);
      await page.getByText('There is nothing at this place.').waitFor();
      await page.keyboard.press('Escape');
      await page.close();
    }
  },

  async 'the PSNR of a camera is that of its picture against its photo'(browser) {
    const exact = await shown(
      browser,
      {},
      {at: 'c=0&ui=0', width: CAMERAS[0].width, height: CAMERAS[0].height},
    );
    await ready(exact);
    const wanted = await psnr(
      exact,
      await exact.screenshot(),
      plainPng(CAMERAS[0].width, CAMERAS[0].height, PHOTO),
    );
    await exact.close();
    const page = await shown(browser, {}, {at: 'camera=0'});
    await ready(page);
    await set(page, 'show', 'depth'); // is of no matter
    await page.keyboard.press('m');
    await page.getByText('front.png: ').waitFor();
    const found = Number((await page.locator('.tool .said').innerText()).match(/: ([\d.]+) dB/)[1]);
    assert.ok(Math.abs(found - wanted) < 0.02, `${found} instead of ${wanted}`);
    await page.keyboard.press('ArrowLeft'); // a camera without a photo
    await page.getByText('PSNR needs the view of a camera with a photo.').waitFor();
    assert.ok(await page.getByRole('button', {name: 'PSNR against the photo'}).isDisabled());
    await page.close();
  },

  async 'depth and normals are drawn by the page: near is light, and what faces the eye is blue'(
    browser,
  ) {
    const {width, height} = CAMERAS[0];
    const page = await shown(browser, {}, {at: 'c=0&ui=0&show=depth', width, height});
    await ready(page);
    const at = BLOBS.map(({at}) => seenAt(CAMERAS[0], at));
    const [middle, , , far] = await colorsAt(page, await page.screenshot(), at);
    const light = color => color.reduce((sum, c) => sum + c);
    assert.ok(light(middle) > light(far) + 150 && light(far) > 20, `${middle} ${far}`);
    assert.deepEqual(await colorAt(page, [10, 10]), [0, 0, 0]);
    await page.keyboard.press('3');
    await settled(page);
    const normals = await colorsAt(page, await page.screenshot(), at);
    for (const color of normals) assert.ok(isNear(color, [128, 128, 255], 6), String(color));
    await page.close();
  },

  async 'the tools have room on a phone'(browser) {
    const page = await shown(browser, {}, {width: 390, height: 844, at: 'camera=0'});
    await ready(page);
    await assertInside(page, 'closed');
    await page.getByRole('button', {name: 'Tools', exact: true}).click();
    const titles = await page.evaluate(() => app.viewer.toolPanel.tools.map(({title}) => title));
    for (const title of titles) {
      await tool(page, title);
      await assertInside(page, title);
      await shot(page, `phone-tool-${title.toLowerCase()}`);
    }
    await page.getByRole('button', {name: 'Settings', exact: true}).click();
    await assertInside(page, 'Settings');
    await page.close();
  },
};

await runAll(tests);
