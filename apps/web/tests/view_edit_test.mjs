// SPDX-License-Identifier: Apache-2.0
// What the viewer makes for other commands: crops, paths of key frames; the control of a run; colors
// as a photo has them. Software WebGL, no network beyond this machine.
//   node view_edit_test.mjs MODULES OUT CHROMIUM
import assert from 'node:assert/strict';
import {readFile} from 'node:fs/promises';
import {colorsAt} from './pictures.mjs';
import {
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
import {BLOBS, CAMERAS, plyOf, sceneFor, seenAt} from './view_scene.mjs';

const tool = async (page, title) => {
  if (!(await page.locator('.panel.tools').isVisible())) await page.keyboard.press('t');
  await page
    .getByRole('group', {name: 'tool', exact: true})
    .getByRole('button', {name: title})
    .click();
};
const lit = async (page, at) =>
  Math.max(
    ...(
      await colorsAt(page, await page.screenshot(), [await windowPlace(page, CAMERAS[0], at)])
    )[0],
  );
const command = page => page.locator('.tool .command').innerText();

const tests = {
  async 'a box hides what is outside, counts what remains, and says the command'(browser) {
    const page = await shown(browser, {}, {at: 'camera=0'});
    await ready(page);
    await tool(page, 'Crop');
    for (const [label, value] of [
      ['x from', -0.5],
      ['y from', -0.5],
      ['z from', -0.5],
      ['x to', 1.5],
      ['y to', 0.5],
      ['z to', 0.5],
    ]) {
      await page.getByLabel(label, {exact: true}).fill(String(value));
      await page.getByLabel(label, {exact: true}).press('Enter');
    }
    await page.getByText('2 of 4 Gaussians remain.').waitFor();
    assert.equal(
      await command(page),
      "gemsplat edit 'a scene' --keep box=-0.5,-0.5,-0.5,1.5,0.5,0.5 -o cropped.ply",
    );
    await page.evaluate(() => document.activeElement.blur());
    await settled(page);
    assert.deepEqual(await Promise.all(BLOBS.map(async ({at}) => (await lit(page, at)) > 60)), [
      true,
      true,
      false,
      false,
    ]);
    await shot(page, 'crop-light');
    await page.getByRole('group', {name: 'inside'}).getByRole('button', {name: 'Drop'}).click();
    await page.getByText('2 of 4 Gaussians remain.').waitFor();
    assert.match(await command(page), /--drop box=/);
    await settled(page);
    assert.ok((await lit(page, BLOBS[2].at)) > 60 && (await lit(page, BLOBS[1].at)) < 60);
    await page.getByRole('switch', {name: 'hide the rest'}).click();
    await settled(page);
    assert.ok((await lit(page, BLOBS[1].at)) > 60, 'all is shown');
    await page.getByRole('switch', {name: 'hide the rest'}).click();
    await page.keyboard.press('t'); // closed: nothing is cropped
    await settled(page);
    assert.ok((await lit(page, BLOBS[1].at)) > 60);
    await page.close();
  },

  async 'the box of a tilted scene stands upright, and its command turns the model up and back'(
    browser,
  ) {
    const page = await shown(
      browser,
      {scene: sceneFor('file', {cameras: withPhotos, up: [0, -0.9271839, 0.3746066]})},
      {at: 'camera=0'},
    );
    await ready(page);
    await tool(page, 'Crop');
    // Under the turn the blob at y = 0.8 has the height 0.74.
    for (const [label, value] of [
      ['x from', -0.5],
      ['y from', 0.7],
      ['z from', -0.5],
      ['x to', 1.5],
      ['y to', 0.78],
      ['z to', 0.5],
    ]) {
      await page.getByLabel(label, {exact: true}).fill(String(value));
      await page.getByLabel(label, {exact: true}).press('Enter');
    }
    await page.getByText('1 of 4 Gaussians remain.').waitFor();
    assert.equal(
      await command(page),
      "gemsplat edit 'a scene' --up 0,-0.9271839,0.3746066 --keep box=-0.5,0.7,-0.5,1.5,0.78,0.5 --restore-frame -o cropped.ply",
    );
    await page.evaluate(() => document.activeElement.blur());
    await settled(page);
    assert.deepEqual(await Promise.all(BLOBS.map(async ({at}) => (await lit(page, at)) > 60)), [
      false,
      false,
      true,
      false,
    ]);
    await shot(page, 'crop-upright');
    await page.getByRole('group', {name: 'shape'}).getByRole('button', {name: 'Sphere'}).click();
    assert.doesNotMatch(await command(page), /--up/); // a sphere has no axes
    await page.close();
  },

  async 'a sphere, a handle that is dragged, coordinates far from the origin, and names that shells would split'(
    browser,
  ) {
    const scene = sceneFor('file', {cameras: withPhotos, world_offset: [500000, 5400000, 0]});
    Object.assign(scene, {title: 'a model.ply', path: "it's in/a model.ply"});
    const page = await shown(browser, {scene}, {at: 'camera=0', colorScheme: 'dark'});
    await ready(page);
    await tool(page, 'Crop');
    await page.getByRole('group', {name: 'shape'}).getByRole('button', {name: 'Sphere'}).click();
    await page.getByLabel('radius', {exact: true}).fill('0.9');
    await page.getByLabel('radius', {exact: true}).press('Enter');
    await page.getByText('2 of 4 Gaussians remain.').waitFor();
    assert.equal(
      await command(page),
      "gemsplat edit 'it'\\''s in/a model.ply' --keep sphere=500000,5400000,0,0.9 -o cropped.ply",
    );
    await page.evaluate(() => document.activeElement.blur());
    const [x, y] = await windowPlace(page, CAMERAS[0], [0.9, 0, 0]),
      [to] = await windowPlace(page, CAMERAS[0], [1.3, 0, 0]);
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(to, y, {steps: 8});
    await page.mouse.up();
    assert.equal((await state(page)).camera, 0, 'the handle moves, not the view');
    await page.getByText('4 of 4 Gaussians remain.').waitFor();
    const radius = Number((await command(page)).match(/,([\d.]+) -o/)[1]);
    assert.ok(Math.abs(radius - 1.3) < 0.03, radius);
    await settled(page);
    await shot(page, 'sphere-dark');
    await page.close();
  },

  async 'a path is set from views, previewed, and saved for render'(browser) {
    const page = await shown(browser, {}, {at: 'camera=0'});
    await ready(page);
    await tool(page, 'Path');
    assert.ok(await page.getByRole('button', {name: 'Save path.json'}).isDisabled());
    await page.keyboard.press('v');
    for (const index of [1, 2]) {
      await page.evaluate(index => gemsplatViewer.setCamera(index), index);
      await page.getByRole('button', {name: 'Add this view'}).click();
    }
    assert.equal(await page.locator('.keys li').count(), 3);
    await page.getByRole('button', {name: 'move view 3 up'}).click();
    const [file] = await Promise.all([
      page.waitForEvent('download'),
      page.getByRole('button', {name: 'Save path.json'}).click(),
    ]);
    assert.equal(file.suggestedFilename(), 'path.json');
    const path = JSON.parse(await readFile(await file.path(), 'utf8'));
    assert.deepEqual(
      [path.format, path.version, path.closed, path.pace, path.seconds],
      ['gemsplat key frames', 1, false, 'even', 6],
    );
    const places = [0, 2, 1].map(i => CAMERAS[i].world_from_camera);
    path.keys.forEach(({position, rotation, width, fx}, i) => {
      const m = places[i];
      assert.ok(distance(position, [m[3], m[7], m[11]]) < 1e-6);
      assert.ok(
        distance(rotation.flat(), [...m.slice(0, 3), ...m.slice(4, 7), ...m.slice(8, 11)]) < 1e-6,
      );
      assert.ok(width === CAMERAS[[0, 2, 1][i]].width && fx === CAMERAS[[0, 2, 1][i]].fx);
    });
    assert.match(await command(page), /^gemsplat render 'a scene' --path path.json -o film.mp4$/);
    await page.getByRole('button', {name: 'View 1', exact: true}).click();
    await settled(page);
    await shot(page, 'path-light');
    await page.getByLabel('seconds of the path').fill('2');
    await page.getByLabel('seconds of the path').press('Enter');
    await page.evaluate(() => {
      window.seen = [];
      const {stage} = app.viewer,
        drawn = stage.drawn;
      stage.drawn = view => {
        drawn(view);
        window.seen.push(view.pose.position.toArray());
      };
    });
    await page.getByRole('button', {name: 'Preview'}).click();
    await page.waitForFunction(() => !app.viewer.tools.path.isPlaying);
    const seen = await page.evaluate(() => window.seen);
    assert.ok(
      seen.length > 3 &&
        distance(
          seen.at(-1),
          CAMERAS[1].world_from_camera.filter((_, i) => [3, 7, 11].includes(i)),
        ) < 1e-6,
    );
    await page.getByRole('button', {name: 'remove view 1'}).click();
    await page.getByRole('button', {name: 'remove view 1'}).click();
    assert.ok(await page.getByRole('button', {name: 'Preview'}).isDisabled());
    await page.close();
  },

  async 'a run is paused, saved and stopped with the token of the printed address, which is not shared'(
    browser,
  ) {
    const control = {paused: false, saving: false, stopping: false, saved: null, trouble: ''},
      asked = [];
    const run = {
      step: 100,
      steps: 1000,
      loss: 0.2,
      losses: [],
      gaussians: 4,
      psnr: null,
      seconds: 10,
      version: 1,
      done: false,
      stopped: false,
      message: '',
      control,
    };
    const take = (what, token) => {
      asked.push([what, token]);
      if (what === 'pause' || what === 'resume') control.paused = what === 'pause';
      if (what === 'save') control.saved = 100;
      if (what === 'stop') control.stopping = true;
    };
    const page = await shown(
      browser,
      {scene: sceneFor('live', {cameras: withPhotos}), state: () => run, control: take},
      {at: 'control=abc123&camera=0'},
    );
    await page.waitForFunction(() => gemsplatViewer.state()?.gaussians === 4);
    assert.doesNotMatch(await page.evaluate(() => location.href), /abc123/);
    assert.ok(!page.server.asked.some(path => path.includes('abc123')));
    await page.getByRole('button', {name: 'Pause'}).click();
    await page.getByText('Paused.').waitFor();
    await shot(page, 'run-paused-light');
    await page.getByRole('button', {name: 'Save now'}).click();
    await page.getByText('Saved the model of step 100.').waitFor();
    await page.getByRole('button', {name: 'Resume'}).click();
    await page.getByRole('button', {name: 'Pause'}).waitFor();
    await page.getByRole('button', {name: 'Stop', exact: true}).click();
    assert.equal(asked.length, 3, 'one press stops nothing');
    await page.getByRole('button', {name: 'Stop: sure?'}).click();
    await page.getByText('Stopping: the model is saved.').waitFor();
    assert.deepEqual(asked, [
      ['pause', 'abc123'],
      ['save', 'abc123'],
      ['resume', 'abc123'],
      ['stop', 'abc123'],
    ]);
    browser.isForgiving = true; // of requests that nobody answers
    await page.server.close();
    await page.getByText('The run was stopped, and its model is saved.', {exact: false}).waitFor();
    await page.close();
    const other = await shown(
      browser,
      {
        scene: sceneFor('live', {cameras: withPhotos}),
        state: () => ({...run, control: {...control, stopping: false}}),
      },
      {at: 'camera=0'},
    );
    await other.getByText('open the address that gemsplat printed', {exact: false}).waitFor();
    assert.equal(await other.getByRole('button', {name: 'Pause'}).count(), 0);
    await other.close();
  },

  async 'colors are those of a photo where the model has learned them'(browser) {
    const gains = {gain: [0.5, 1, 1]},
      others = {gain: [1, 0.8, 1.1]};
    const cameras = withPhotos.map((camera, i) => ({
      ...camera,
      look: [gains, null, others, null][i] ?? undefined,
    }));
    const {width, height} = CAMERAS[0];
    for (const index of [0, 2]) {
      const page = await shown(
        browser,
        {scene: sceneFor('file', {cameras})},
        {at: `c=${index}&ui=0&colors=photo`, width, height},
      );
      await ready(page);
      const places = BLOBS.map(({at}) => seenAt(CAMERAS[index], at)),
        inside = ([x, y]) => x > 0 && y > 0 && x < width && y < height;
      const colors = await colorsAt(page, await page.screenshot(), places.filter(inside));
      const wanted = BLOBS.filter((_, i) => inside(places[i])).map(({color}) =>
        lookOf(cameras[index], color),
      );
      colors.forEach((color, i) =>
        assert.ok(isNear(color, wanted[i], 5), `${color} instead of ${wanted[i]}`),
      );
      await page.keyboard.press('4');
      await settled(page);
      assert.ok(
        isNear(
          (await colorsAt(page, await page.screenshot(), [places[0]]))[0],
          BLOBS[0].color.map(c => 255 * c),
          5,
        ),
        'neutral',
      );
      await page.close();
    }
    const plain = await shown(browser, {});
    await ready(plain);
    await plain.keyboard.press('p');
    assert.equal(
      await plain.getByRole('group', {name: 'colors'}).count(),
      0,
      'no model, no switch',
    );
    await plain.close();
  },

  async 'a paused run has room on a phone'(browser) {
    const run = {
      step: 100,
      steps: 1000,
      loss: 0.2,
      losses: [
        [10, 0.5],
        [100, 0.2],
      ],
      gaussians: 4,
      psnr: 20,
      seconds: 10,
      version: 1,
      done: false,
      stopped: false,
      message: '',
      control: {paused: true, saving: false, stopping: false, saved: 90, trouble: ''},
    };
    const page = await shown(
      browser,
      {scene: sceneFor('live', {cameras: withPhotos}), state: () => run, model: () => plyOf(BLOBS)},
      {at: 'control=abc&camera=0', width: 390, height: 844},
    );
    await page.waitForFunction(() => gemsplatViewer.state()?.gaussians === 4);
    await page.getByRole('button', {name: 'Training', exact: true}).click();
    await page.getByRole('button', {name: 'Resume'}).waitFor();
    await assertInside(page, 'training');
    await shot(page, 'phone-run');
    await page.close();
  },
};

// What a photo shows of a color (docs/method/photometric.md), 0 to 255.
function lookOf({look: {gain}}, color) {
  return color.map((c, i) => 255 * Math.min(1, gain[i] * c));
}

await runAll(tests);
