// SPDX-License-Identifier: Apache-2.0
// What the browser tests of the viewer share: the page of a small server, its states, and the loop
// over a file's tests. The arguments of such a file are MODULES OUT CHROMIUM; MODULES holds
// node_modules and view.html, and screenshots go to OUT.
import assert from 'node:assert/strict';
import {mkdir} from 'node:fs/promises';
import {join, resolve} from 'node:path';
import {Browser, findChromium, finish} from './browser.mjs';
import {BLOBS, CAMERAS, plainPng, plyOf, sceneFor} from './view_scene.mjs';
import {ViewServer} from './view_server.mjs';

const [modules, out] = process.argv.slice(2, 4).map(path => resolve(path)),
  chromium = findChromium(process.argv[4]);

export const PHOTO = [200, 30, 160];
export const withPhotos = CAMERAS.map((camera, i) => ({
  ...camera,
  photo: i === 3 ? null : `photo/${i}`,
}));
const photoOf = index => plainPng(withPhotos[index].width, withPhotos[index].height, PHOTO);

/// Opens the page of a server that serves `what` (see ViewServer). Page and server are closed after
/// the test.
export async function shown(browser, what, options) {
  const server = await ViewServer.start({
    page: join(modules, 'view.html'),
    scene: sceneFor('file', {cameras: withPhotos}),
    model: () => plyOf(BLOBS),
    photo: photoOf,
    ...what,
  });
  browser.servers.push(server);
  const page = await browser.openServer(server.url, options);
  page.server = server;
  return page;
}

export const ready = page =>
  page.waitForFunction(() =>
    gemsplatViewer.ready.then(() => gemsplatViewer.settled()).then(() => true),
  );
export const settled = page =>
  page.waitForFunction(() => gemsplatViewer.settled().then(() => true));
export const state = page => page.evaluate(() => gemsplatViewer.state());
export const distance = (a, b) => Math.hypot(...a.map((x, i) => x - b[i]));
export const shot = async (page, name) => page.screenshot({path: join(out, `${name}.png`)});
export const isNear = (color, wanted, tolerance = 12) =>
  color.every((c, i) => Math.abs(c - wanted[i]) <= tolerance);

/// Where the window shows a point of the world at the camera that the view is exactly at.
export async function windowPlace(page, camera, [x, y, z]) {
  const {world_from_camera: m, fx, fy, cx, cy} = camera,
    depth = z - m[11];
  const {left, top, width} = await page.evaluate(() => app.viewer.stage.lens().picture),
    scale = width / camera.width;
  return [
    left + scale * ((fx * (x - m[3])) / depth + cx),
    top + scale * ((fy * (y - m[7])) / depth + cy),
  ];
}

/// Fails where something that is shown sticks out of the window, or out of the panel that it is in.
export async function assertInside(page, name) {
  const outside = await page.evaluate(() => {
    const panel = document.querySelector('.panel:not([hidden]) .panel-body'),
      box = panel?.getBoundingClientRect();
    const within = [...(panel?.querySelectorAll('*') ?? [])].filter(
      each => each.getClientRects().length,
    );
    const wide = within.filter(
      each =>
        each.getBoundingClientRect().right > box.right + 0.5 ||
        each.getBoundingClientRect().left < box.left - 0.5,
    );
    const shown = [
      ...document.querySelectorAll('.head > *, .panel:not([hidden]), .bottom > *'),
    ].filter(each => each.getClientRects().length);
    const far = shown.filter(each => {
      const {left, top, right, bottom} = each.getBoundingClientRect();
      return left < 0 || top < 0 || right > innerWidth + 0.5 || bottom > innerHeight + 0.5;
    });
    return [...wide, ...far].map(
      each =>
        `${each.tagName}.${each.className?.baseVal ?? each.className} ${JSON.stringify(each.getBoundingClientRect())}`,
    );
  });
  assert.deepEqual(outside, [], name);
}

/// Runs the tests of a file in one browser, and ends the process.
export async function runAll(tests) {
  await mkdir(out, {recursive: true});
  const browser = await Browser.start(modules, chromium, {server: true});
  browser.context.setDefaultTimeout(30_000);
  const failed = await browser.runTests(tests, {
    before() {
      browser.servers = [];
      browser.isForgiving = false; // of errors that the test itself has made
    },
    check() {
      if (!browser.isForgiving) assert.deepEqual(browser.failures, []);
      assert.ok(
        !browser.failures.some(failure => failure.includes(': request: ')),
        browser.failures.join('\n'),
      );
    },
    after: () =>
      Promise.all(browser.servers.map(server => server.http.listening && server.close())),
  });
  finish(failed, `screenshots: ${out}`);
}
