// SPDX-License-Identifier: Apache-2.0
// The viewer in a browser: a few Gaussians at known places, cameras, photos, a run that trains,
// frames from a server; clicks, drags, keys, touches. Software WebGL, no network beyond this
// machine. Writes screenshots into OUT.
//   node view_test.mjs MODULES OUT CHROMIUM
import assert from 'node:assert/strict';
import {colorsAt} from './pictures.mjs';
import {
  PHOTO,
  distance,
  isNear,
  ready,
  runAll,
  settled,
  shot,
  shown,
  state,
  withPhotos,
} from './view_page.mjs';
import {BLOBS, CAMERAS, plainPng, plyOf, sceneFor, seenAt} from './view_scene.mjs';

const helpGroups = page => page.locator('.help h3').allInnerTexts();
const photoBox = page => page.locator('.compare').boundingBox();

// Each blob stands where `camera` sees it, in a picture of its size without interface.
async function assertBlobs(page, camera, blobs = BLOBS) {
  const picture = await page.screenshot(),
    places = blobs.map(({at}) => seenAt(camera, at));
  const inside = places
    .map(([x, y], i) => ({x, y, i}))
    .filter(({x, y}) => x >= 0 && y >= 0 && x < camera.width && y < camera.height);
  const colors = await colorsAt(
    page,
    picture,
    inside.map(({x, y}) => [x, y]),
  );
  inside.forEach(({i}, k) => {
    const wanted = blobs[i].color.map(c => 255 * c);
    assert.ok(isNear(colors[k], wanted), `blob ${i}: ${colors[k]} instead of ${wanted}`);
  });
  return inside.length;
}

const tests = {
  async 'colors and places are the exact ones, at centered and off-center cameras, and nothing is mirrored'(
    browser,
  ) {
    for (const [index, camera] of CAMERAS.entries()) {
      const page = await shown(
        browser,
        {},
        {at: `c=${index}&ui=0`, width: camera.width, height: camera.height},
      );
      await ready(page);
      assert.ok((await assertBlobs(page, camera)) >= 2);
      assert.equal((await state(page)).camera, index);
      await page.close();
    }
  },

  async 'model panel, list and bar say what is there; names cannot become markup'(browser) {
    const page = await shown(browser, {});
    await ready(page);
    assert.equal((await state(page)).gaussians, BLOBS.length);
    const figures = await page.locator('.panel.model').innerText();
    for (const words of ['blobs.ply', 'Gaussians', '4', 'SH degree', '4, 2 of them test'])
      assert.ok(figures.includes(words), figures);
    await page.getByRole('button', {name: 'Cameras', exact: true}).click();
    assert.deepEqual(
      await page.locator('.entry').allTextContents(),
      CAMERAS.map(camera => camera.name),
    );
    await page
      .getByRole('group', {name: 'which cameras'})
      .getByRole('button', {name: 'Test'})
      .click();
    assert.equal(await page.locator('.entry:visible').count(), 2);
    await page.getByPlaceholder('Filter by name').fill('ODD');
    assert.equal(await page.locator('.entry:visible').count(), 1);
    await page.locator('.entry:visible').click();
    assert.equal((await state(page)).camera, 3);
    await settled(page);
    assert.equal(await page.locator('.bar-name').innerText(), '<b>odd</b>.png\ntest');
    assert.equal(await page.locator('.camera-bar .segmented:visible').count(), 0); // it has no photo
    await shot(page, 'cameras-light');
    await page.close();
  },

  async 'a view at rest is not drawn again'(browser) {
    const page = await shown(browser, {});
    await ready(page);
    const drawn = await page.evaluate(async () => {
      const {stage} = app.viewer,
        tell = stage.drawn;
      let count = 0;
      stage.drawn = view => {
        ++count;
        tell(view);
      };
      await new Promise(done => setTimeout(done, 800));
      return count;
    });
    assert.equal(drawn, 0);
    await page.close();
  },

  async 'a click on a frustum leads to its camera, keys to the next and back'(browser) {
    const page = await shown(browser, {});
    await ready(page);
    assert.equal(
      await page.evaluate(() => app.viewer.stage.frusta.isShown),
      false,
      'frusta are off until asked for',
    );
    await page.keyboard.press('f');
    const {lens} = await state(page),
      target = CAMERAS[3].world_from_camera;
    const [x, y] = seenAt({...CAMERAS[0], ...lens}, [target[3], target[7], target[11]]);
    const box = await page.evaluate(() => app.viewer.stage.lens().picture);
    const scale = box.width / lens.width,
      place = [box.left + x * scale, box.top + y * scale];
    await page.mouse.move(...place);
    assert.equal(await page.locator('canvas.gl').getAttribute('title'), CAMERAS[3].name);
    await page.mouse.click(...place);
    assert.equal((await state(page)).camera, 3);
    await page.keyboard.press('ArrowLeft');
    assert.equal((await state(page)).camera, 2);
    await page.keyboard.press('ArrowRight');
    await page.keyboard.press('ArrowRight');
    assert.equal((await state(page)).camera, 0);
    await page.keyboard.press('f');
    await page.mouse.move(...place);
    assert.equal(await page.locator('canvas.gl').getAttribute('title'), '');
    await page.keyboard.press('KeyW');
    await page.keyboard.press('n');
    assert.equal((await state(page)).camera, 0);
    await page.close();
  },

  async 'the first view is upright where the way up is known, and inside where the server says so'(
    browser,
  ) {
    const lying = {
      ...CAMERAS[0],
      world_from_camera: [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, -4, 0, 0, 0, 1],
    };
    const tilt = page => page.evaluate(() => app.viewer.rig.axis(0, 1, 0).dot(app.viewer.rig.up));
    for (const [known, wanted] of [
      [true, 1],
      [false, 0],
    ]) {
      const page = await shown(browser, {
        scene: sceneFor('file', {cameras: [lying], up_is_known: known}),
      });
      await ready(page);
      assert.ok(
        Math.abs((await tilt(page)) - wanted) < 1e-6,
        `up is ${known ? 'known' : 'a guess'}: ${await tilt(page)}`,
      );
      assert.deepEqual((await state(page)).position, [0, 0, -4]);
      await page.close();
    }
    for (const eye of [undefined, [0.5, 0, -1]]) {
      const page = await shown(browser, {scene: sceneFor('file', {cameras: [], eye})});
      await ready(page);
      const {position, target} = await state(page);
      assert.deepEqual(target, [0, 0, 0]);
      assert.ok(
        eye ? distance(position, eye) < 1e-6 : Math.abs(distance(position, target) - 5) < 1e-6,
        String(position),
      );
      await page.close();
    }
  },

  async 'a page for visitors has a title and no panels, and turns until somebody touches it'(
    browser,
  ) {
    const scene = sceneFor('file', {
      title: 'Our garden',
      cameras: CAMERAS,
      visitors: true,
      turn: {middle: [0, 0, -4], width: 1},
    });
    const still = await shown(browser, {scene}, {at: 'camera=1', reducedMotion: 'no-preference'});
    await ready(still);
    assert.equal((await state(still)).camera, 1, 'an address that names a place is kept');
    await still.close();
    const page = await shown(
      browser,
      {scene},
      {reducedMotion: 'no-preference', colorScheme: 'dark'},
    );
    await page.waitForFunction(() => gemsplatViewer.ready.then(() => true));
    assert.equal(await page.title(), 'Our garden');
    assert.equal(await page.locator('h1').innerText(), 'Our garden');
    assert.equal(await page.locator('.panel, .camera-bar').count(), 0);
    assert.deepEqual(
      await page
        .locator('.head button')
        .evaluateAll(all => all.map(each => each.title.replace(/ \(.*/, ''))),
      ['reset view', 'mouse, fingers and keys', 'full screen'],
    );
    const before = (await state(page)).position;
    await page.waitForFunction(([x, , z]) => {
      const [nx, , nz] = gemsplatViewer.state().position;
      return Math.hypot(nx - x, nz - z) > 0.02;
    }, before);
    await shot(page, 'visitors');
    assert.ok(
      Math.abs(distance((await state(page)).position, [0, 0, 0]) - 4) < 1e-6,
      'on the circle',
    );
    for (const key of ['g', 'p', 'i', 't', 'k', 'f', 'ArrowRight']) await page.keyboard.press(key); // nothing to open
    await settled(page);
    const rest = (await state(page)).position;
    await page.waitForTimeout(300);
    assert.deepEqual((await state(page)).position, rest, 'touched: it stands still');
    await page.keyboard.press('?');
    assert.deepEqual(await helpGroups(page), ['Mouse', 'Keys that move the view', 'Fingers']);
    await shot(page, 'visitors-help');
    await page.close();
    const calm = await shown(browser, {scene}); // who wants little motion
    await ready(calm);
    assert.deepEqual((await state(calm)).position, [0, 0, -4]);
    await calm.close();
  },

  async 'the view flies to a camera, and arrives exactly there'(browser) {
    const page = await shown(browser, {}, {at: 'camera=0', reducedMotion: 'no-preference'});
    await ready(page);
    await page.keyboard.press('ArrowRight');
    assert.equal((await state(page)).camera, null);
    await page.waitForFunction(() => gemsplatViewer.state().camera === 1);
    const {position, lens} = await state(page),
      {world_from_camera: m, width, height, fx, fy, cx, cy} = CAMERAS[1];
    assert.deepEqual(position, [m[3], m[7], m[11]]);
    assert.deepEqual(lens, {width, height, fx, fy, cx, cy});
    await page.close();
  },

  async 'the photo compares with the render by slider, opacity and flip'(browser) {
    const page = await shown(browser, {}, {at: 'camera=0', colorScheme: 'dark'});
    await ready(page);
    await page.getByRole('button', {name: 'Slider'}).click();
    await page.waitForFunction(() => document.querySelector('.photo').naturalWidth > 0);
    const box = await photoBox(page),
      drawn = await page.evaluate(() => app.viewer.stage.lens().picture);
    assert.ok(
      Math.abs(box.width - drawn.width) < 1 && Math.abs(box.left ?? box.x - drawn.left) < 1,
    );
    const at = share => [box.x + share * box.width, box.y + 0.3 * box.height];
    const colors = async () =>
      colorsAt(page, await page.screenshot(), [at(0.1), at(0.35), at(0.9)]);
    assert.deepEqual(
      (await colors()).map(color => isNear(color, PHOTO)),
      [true, true, false],
    );
    await page.keyboard.down(' '); // although the button was pressed last
    assert.deepEqual(
      (await colors()).map(color => isNear(color, PHOTO)),
      [true, true, true],
    );
    await page.keyboard.up(' ');
    await page.mouse.move(...at(0.5));
    await page.mouse.down();
    await page.mouse.move(...at(0.2), {steps: 4});
    await page.mouse.up();
    assert.deepEqual(
      (await colors()).map(color => isNear(color, PHOTO)),
      [true, false, false],
    );
    assert.equal((await state(page)).camera, 0); // the slider moves, not the view
    await shot(page, 'slider-dark');
    await page.keyboard.press('c');
    assert.equal((await state(page)).compare, 'blend');
    assert.ok(
      isNear(
        (await colors())[2],
        PHOTO.map(c => c / 2),
        4,
      ),
      'half a photo over black',
    );
    await page.keyboard.press('c');
    await page.keyboard.press('c');
    assert.equal(await page.locator('.compare').isVisible(), false);
    await page.keyboard.down(' ');
    assert.ok(isNear((await colors())[2], PHOTO));
    await page.keyboard.up(' ');
    assert.equal(await page.locator('.compare').isVisible(), false);
    await page.close();
  },

  async 'mouse, wheel and keys move the view; a double click chooses what orbits go around'(
    browser,
  ) {
    const page = await shown(browser, {});
    await ready(page);
    const start = await state(page);
    await page.mouse.move(640, 450);
    await page.mouse.down();
    await page.mouse.move(760, 400, {steps: 6});
    await page.mouse.up();
    const orbited = await state(page);
    assert.equal(orbited.camera, null);
    assert.ok(distance(orbited.position, start.position) > 0.3);
    assert.ok(
      Math.abs(
        distance(orbited.position, orbited.target) - distance(start.position, start.target),
      ) < 1e-6,
    );
    assert.ok(
      orbited.position[0] < start.position[0] && orbited.position[1] > start.position[1],
      'the scene follows the pointer',
    );
    await page.mouse.wheel(0, -200);
    await page.waitForTimeout(100);
    assert.ok(
      distance((await state(page)).position, orbited.target) <
        distance(orbited.position, orbited.target),
    );
    await page.keyboard.press('r');
    await settled(page);
    await page.keyboard.down('w');
    await page.waitForTimeout(500);
    await page.keyboard.up('w');
    const flown = await state(page);
    assert.ok(flown.position[2] > start.position[2] + 0.01, String(flown.position));
    await page.keyboard.press('r');
    await settled(page);
    const {picture} = await page.evaluate(() => app.viewer.stage.lens()),
      scale = picture.width / CAMERAS[0].width;
    const [x, y] = seenAt(CAMERAS[0], BLOBS[1].at);
    await page.mouse.dblclick(picture.left + x * scale, picture.top + y * scale);
    const {target} = await state(page);
    assert.ok(distance(target, BLOBS[1].at) < 0.3, `${target} instead of ${BLOBS[1].at}`);
    await page.close();
  },

  async 'settings change background, field of view and navigation; help and hidden interface come and go'(
    browser,
  ) {
    const page = await shown(browser, {}, {colorScheme: 'dark'});
    await ready(page);
    await page.keyboard.press('p');
    await page
      .getByRole('group', {name: 'background'})
      .getByRole('button', {name: 'White'})
      .click();
    await page.getByRole('slider', {name: 'field of view'}).fill('100');
    await page.keyboard.press('o');
    assert.equal(
      await page
        .getByRole('group', {name: 'navigation'})
        .getByRole('button', {name: 'Fly'})
        .getAttribute('aria-pressed'),
      'true',
    );
    await settled(page);
    assert.ok(Math.abs((await state(page)).lens.fy - 900 / 2 / Math.tan((50 * Math.PI) / 180)) < 1);
    await shot(page, 'settings-dark');
    await page.keyboard.press('?');
    await page.getByRole('dialog').waitFor();
    assert.deepEqual(await helpGroups(page), [
      'Mouse',
      'Keys that move the view',
      'Cameras and photos',
      'Picture and tools',
      'Time, where the scene moves',
      'Page',
      'Fingers',
    ]);
    await shot(page, 'help-dark');
    await page.keyboard.press('Escape');
    await page.keyboard.press('h');
    assert.equal(await page.locator('.interface').isVisible(), false);
    assert.ok(
      isNear((await colorsAt(page, await page.screenshot(), [[20, 880]]))[0], [255, 255, 255], 1),
    );
    await page.close();
  },

  async 'a panel closes the one whose column of the page it takes'(browser) {
    const page = await shown(browser, {});
    await ready(page);
    const open = async () =>
      (
        await page.locator('.panel:visible').evaluateAll(list => list.map(panel => panel.id))
      ).sort();
    await page.keyboard.press('g');
    assert.deepEqual(await open(), ['panel-cameras', 'panel-model']);
    await page.keyboard.press('p');
    assert.deepEqual(await open(), ['panel-model', 'panel-settings']);
    await page.getByRole('button', {name: 'Cameras', exact: true}).click();
    assert.deepEqual(await open(), ['panel-cameras', 'panel-model']);
    await shot(page, 'panels-light');
    await page.setViewportSize({width: 390, height: 844}); // a window made narrow has one column
    await page.waitForFunction(
      () => document.querySelectorAll('.panel:not([hidden])').length === 1,
    );
    assert.deepEqual(await open(), ['panel-cameras']);
    await page.close();
  },

  async 'a run that goes on: facts, chart, and a new model without losing the pose and without a flash'(
    browser,
  ) {
    const run = {
      step: 100,
      steps: 1000,
      loss: 0.2,
      gaussians: 4,
      psnr: null,
      seconds: 10,
      version: 0,
      done: false,
      stopped: false,
      message: '',
    };
    const logged = [
      [10, 0.5],
      [50, 0.3],
      [100, 0.2],
    ]; // before the page was opened
    const stateOf = after => ({...run, losses: logged.filter(([step]) => step > after)});
    const live = {...sceneFor('live', {cameras: withPhotos})},
      {model} = live;
    delete live.model;
    const bright = BLOBS.map(blob => ({...blob, color: [0.9, 0.5, 0.1]}));
    const page = await shown(
      browser,
      {scene: live, state: stateOf, model: version => plyOf(version < 2 ? BLOBS : bright)},
      {at: 'camera=0'},
    );
    await page.evaluate(() => gemsplatViewer.ready);
    assert.match(await page.locator('.live-words').innerText(), /first model/i);
    live.model = model;
    logged.push([200, 0.15]);
    Object.assign(run, {version: 1, step: 200, loss: 0.15, psnr: 21.5});
    await page.waitForFunction(() => gemsplatViewer.state().gaussians === 4);
    await settled(page);
    await page.mouse.move(640, 450);
    await page.mouse.wheel(0, 60);
    await settled(page);
    const before = await state(page);
    await page.evaluate(() => {
      // what is drawn in the middle, frame by frame
      const {stage} = app.viewer,
        drawn = stage.drawn,
        gl = stage.renderer.getContext(),
        pixel = new Uint8Array(4);
      window.middle = [];
      stage.drawn = view => {
        drawn(view);
        const bound = gl.getParameter(gl.PIXEL_PACK_BUFFER_BINDING); // Spark's, while it reads depths
        gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
        gl.readPixels(
          gl.drawingBufferWidth / 2,
          gl.drawingBufferHeight / 2,
          1,
          1,
          gl.RGBA,
          gl.UNSIGNED_BYTE,
          pixel,
        );
        gl.bindBuffer(gl.PIXEL_PACK_BUFFER, bound);
        window.middle.push([...pixel.subarray(0, 3)]);
      };
      stage.request();
    });
    logged.push([300, 0.1]);
    Object.assign(run, {version: 2, step: 300, loss: 0.1});
    await page.waitForFunction(() => window.middle.some(([r, g, b]) => r - b > 120), null, {
      timeout: 20_000,
    });
    await settled(page);
    const colors = await page.evaluate(() => window.middle),
      old = colors[0],
      latest = colors.at(-1);
    assert.ok(latest[0] - latest[2] > 120 && old[0] - old[2] < 20);
    for (const color of colors)
      assert.ok(isNear(color, old, 6) || isNear(color, latest, 6), `a frame between: ${color}`);
    const after = await state(page);
    assert.deepEqual(
      [after.position, after.quaternion, after.lens],
      [before.position, before.quaternion, before.lens],
    );
    const words = await page.locator('.panel.model').innerText();
    for (const word of ['300 of 1,000', '21.50 dB', '0.1', 'Snapshot'])
      assert.ok(words.includes(word), words);
    assert.equal(await page.locator('.loss-chart canvas').count(), 1);
    run.step = 320; // a poll without a new loss adds no point
    await page.getByText('320 of 1,000').waitFor();
    const points = () => page.evaluate(() => app.viewer.live.plot.data.map(list => [...list]));
    assert.deepEqual(await points(), [
      [10, 50, 100, 200, 300],
      [0.5, 0.3, 0.2, 0.15, 0.1],
    ]);
    assert.equal(await page.evaluate(() => app.viewer.live.plot.scales.x.min), 10);
    await shot(page, 'live-light');
    run.step = 120; // the run went back to a checkpoint
    logged.splice(3);
    await page.getByText('120 of 1,000').waitFor();
    assert.deepEqual((await points())[0], [10, 50, 100]);
    Object.assign(run, {done: true, message: 'Training is done.'});
    await page.waitForFunction(
      () => document.querySelector('.live-words').textContent === 'Training is done.',
    );
    const asked = page.server.asked.length;
    await page.waitForTimeout(1500);
    assert.equal(page.server.asked.length, asked); // nothing more to ask
    await page.close();
  },

  async 'frames from the server: small ones while the view moves, whole ones at rest, color, depth, normals'(
    browser,
  ) {
    const colors = {color: [180, 90, 20], depth: [90, 90, 90], normal: [120, 120, 250]};
    const frames = [];
    const frame = async query => {
      frames.push(query);
      await new Promise(done => setTimeout(done, 120));
      return {
        body: plainPng(Number(query.get('w')), Number(query.get('h')), colors[query.get('mode')]),
        milliseconds: 12.5,
      };
    };
    const page = await shown(
      browser,
      {
        scene: sceneFor('remote', {
          device: 'cuda:0 (a test)',
          model: {gaussians: 7},
          cameras: CAMERAS.map((camera, i) => ({...camera, has_lens: i === 0})),
        }),
        frame,
      },
      {at: 'camera=0'},
    );
    await ready(page);
    assert.ok(!page.server.asked.some(path => path.startsWith('/model')));
    const first = frames.at(-1);
    assert.deepEqual([Number(first.get('w')), Number(first.get('h'))], [1280, 900]);
    assert.equal(first.get('lens'), '0');
    assert.deepEqual(first.get('m').split(',').map(Number), CAMERAS[0].world_from_camera);
    const {picture} = await page.evaluate(() => app.viewer.stage.lens());
    assert.ok(
      Math.abs(Number(first.get('cx')) - picture.left - picture.width / 2) < 1e-3 &&
        Math.abs(Number(first.get('fx')) - (300 * picture.width) / 400) < 1e-3,
    );
    assert.ok(
      isNear((await colorsAt(page, await page.screenshot(), [[640, 450]]))[0], colors.color, 2),
    );
    const count = frames.length;
    await page.mouse.move(640, 450);
    await page.mouse.down();
    for (let i = 0; i < 12; ++i) {
      await page.mouse.move(640 + 10 * i, 450);
      await page.waitForTimeout(40);
    }
    await page.mouse.up();
    await settled(page);
    const moving = frames.slice(count, -1).map(query => Number(query.get('w')));
    assert.ok(moving.length > 1 && Math.min(...moving) < 700, String(moving));
    assert.equal(Number(frames.at(-1).get('w')), 1280);
    assert.equal(frames.at(-1).get('lens'), null); // the view is no camera's any more
    const facts = await page.locator('.panel.model').innerText();
    assert.ok(Number(facts.match(/Latency\s+(\d+) ms/)[1]) >= 120, facts); // what the server waits, and more on a busy machine
    assert.match(facts, /On the server\s+12\.5 ms/);
    assert.match(facts, /cuda:0/);
    await page.keyboard.press('p');
    await page.getByRole('button', {name: 'Normals'}).click();
    await settled(page);
    assert.ok(
      isNear((await colorsAt(page, await page.screenshot(), [[640, 600]]))[0], colors.normal, 2),
    );
    await shot(page, 'remote-light');
    const pressed = () =>
      page.getByRole('group', {name: 'picture'}).locator('[aria-pressed=true]').innerText();
    assert.equal(await pressed(), 'Normals');
    for (const [key, name] of [
      ['2', 'Depth'],
      ['3', 'Normals'],
      ['1', 'Color'],
    ]) {
      await page.keyboard.press(key);
      assert.equal(await pressed(), name);
    }
    await settled(page);
    page.server.what.frame = () => {
      throw Object.assign(new Error('The GPU is out of memory.'), {status: 503});
    };
    browser.isForgiving = true;
    await page.keyboard.press('3');
    await page.keyboard.press('1');
    await page.getByText('The GPU is out of memory.').waitFor();
    await page.close();
  },

  async 'without WebGL frames from the server are shown all the same, and else it is said what is missing'(
    browser,
  ) {
    browser.isForgiving = true; // three.js complains
    const frame = query => ({
      body: plainPng(Number(query.get('w')), Number(query.get('h')), [10, 200, 90]),
      milliseconds: 1,
    });
    for (const mode of ['remote', 'file']) {
      const page = await shown(
        browser,
        {scene: sceneFor(mode), frame},
        {
          before: () => {
            const getContext = HTMLCanvasElement.prototype.getContext;
            HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
              return kind.startsWith('webgl') ? null : getContext.call(this, kind, ...more);
            };
          },
        },
      );
      if (mode === 'file') {
        await page.locator('.failure').waitFor();
        assert.match(
          await page.locator('.failure').innerText(),
          /no WebGL 2.*gemsplat view --remote/,
        );
      } else {
        await ready(page);
        assert.ok(
          isNear(
            (await colorsAt(page, await page.screenshot(), [[640, 450]]))[0],
            [10, 200, 90],
            2,
          ),
        );
      }
      await page.close();
    }
  },

  async 'what goes wrong is said in words'(browser) {
    browser.isForgiving = true;
    const refuse = (status, message) => () => {
      throw Object.assign(new Error(message), {status});
    };
    const broken = await shown(browser, {model: () => Buffer.from('ply\nthis is none')});
    await broken.locator('.failure, .message').waitFor();
    assert.match(
      await broken.locator('.failure, .message').innerText(),
      /^The model cannot be shown: ./,
    );
    await broken.close();
    const missing = await shown(browser, {
      model: refuse(404, 'The file blobs.ply is not there any more.'),
    });
    await missing.getByText('The file blobs.ply is not there any more.').waitFor();
    await missing.close();
    const lost = await shown(
      browser,
      {
        photo: refuse(404, 'no photo'),
        scene: sceneFor('file', {
          cameras: withPhotos,
          notes: ['Photos were not found: images/ has moved.'],
        }),
      },
      {at: 'camera=0'},
    );
    await ready(lost);
    await lost.getByText('Photos were not found').waitFor();
    await lost.getByRole('button', {name: 'Photo', exact: true}).click();
    await lost.getByText('the photo cannot be shown').waitFor();
    await lost.close();
    const silent = await shown(browser, {});
    await ready(silent);
    await silent.server.close();
    await silent.reload().catch(() => {});
    await silent.close();
  },

  async 'a phone has room for all of it, and fingers move the view'(browser) {
    for (const colorScheme of ['light', 'dark']) {
      const page = await shown(browser, {}, {width: 390, height: 844, colorScheme, at: 'camera=0'});
      await ready(page);
      assert.equal(await page.locator('.panel:visible').count(), 0);
      for (const name of ['Cameras', 'Settings', 'Model']) {
        await page.getByRole('button', {name, exact: true}).click();
        assert.equal(await page.locator('.panel:visible').count(), 1, 'one panel at a time');
        const {x, y, width, height} = await page.locator('.panel:visible').boundingBox();
        assert.ok(x >= 0 && y >= 0 && x + width <= 390 && y + height <= 844, name);
        await shot(page, `phone-${name.toLowerCase()}-${colorScheme}`);
      }
      await page.getByRole('button', {name: 'close Model'}).click();
      await page.getByRole('button', {name: 'mouse, fingers and keys (?)'}).click();
      assert.equal((await helpGroups(page))[0], 'Fingers');
      await shot(page, `phone-help-${colorScheme}`);
      await page.keyboard.press('Escape');
      const session = await page.context().newCDPSession(page);
      await session.send('Emulation.setTouchEmulationEnabled', {enabled: true, maxTouchPoints: 2});
      const touch = (type, points) =>
        session.send('Input.dispatchTouchEvent', {
          type,
          touchPoints: points.map(([x, y], id) => ({x, y, id})),
        });
      const before = await state(page);
      await touch('touchStart', [
        [150, 400],
        [240, 400],
      ]);
      for (const d of [10, 20, 30, 40])
        await touch('touchMove', [
          [150 - d, 400],
          [240 + d, 400],
        ]);
      await touch('touchEnd', []);
      const pinched = await state(page);
      assert.ok(
        distance(pinched.position, pinched.target) <
          0.75 * distance(before.position, before.target),
        'fingers apart come nearer',
      );
      await touch('touchStart', [[195, 400]]);
      for (const d of [10, 30, 60]) await touch('touchMove', [[195 + d, 400]]);
      await touch('touchEnd', []);
      const turned = await state(page);
      assert.ok(turned.position[0] < pinched.position[0] - 0.1, 'one finger orbits');
      await settled(page);
      await shot(page, `phone-${colorScheme}`);
      await page.close();
    }
  },
};

await runAll(tests);
