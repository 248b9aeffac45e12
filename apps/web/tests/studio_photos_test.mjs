// SPDX-License-Identifier: Apache-2.0
// The tiles of the studio's screen Photos: a photo is turned, another one is masked with a brush, and
// training takes both. studio_desk.mjs has the command line.
import assert from 'node:assert/strict';
import {cpSync, existsSync, readFileSync, readdirSync} from 'node:fs';
import {join} from 'node:path';
import {
  Desk,
  chooseSmallRun,
  out,
  projectOf,
  runAll,
  scene,
  typeFolder,
  withColmap,
} from './studio_desk.mjs';

const TURNED = 'view_002.jpg',
  MASKED = 'view_001.jpg';
const photos = join(out, 'photos'); // a folder of the person's own
const ofPhoto = (desk, what, name) => desk.page.getByRole('button', {name: `${what}: ${name}`});
const bytesOfPhotos = () => readdirSync(photos).map(name => readFileSync(join(photos, name)));

// How bright a picture of the studio is around a place of it, 0 to 1; places are shares of its sides.
const brightnessAt = (desk, address, x, y) =>
  desk.page.evaluate(
    async ([address, x, y]) => {
      const image = new Image();
      image.src = address;
      await image.decode();
      const canvas = document.createElement('canvas'),
        pen = canvas.getContext('2d', {willReadFrequently: true});
      [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
      pen.drawImage(image, 0, 0);
      const {data} = pen.getImageData(x * canvas.width - 3, y * canvas.height - 3, 6, 6),
        reds = data.filter((_, i) => i % 4 === 0);
      return reds.reduce((sum, red) => sum + red, 0) / reds.length / 255;
    },
    [address, x, y],
  );
const fileOf = (desk, path) => `p/${encodeURIComponent(desk.id)}/file/${path}`;

// Paints a line from one place of the photo to another one; places are shares of its sides.
async function paint({page}, [x0, y0], [x1, y1]) {
  const {x, y, width, height} = await page.locator('.paint canvas').boundingBox();
  await page.mouse.move(x + x0 * width, y + y0 * height);
  await page.mouse.down();
  await page.mouse.move(x + x1 * width, y + y1 * height, {steps: 4});
  await page.mouse.up();
}
const dialogOf = ({page}) => page.locator('.mask-dialog');
async function openMask(desk, name) {
  await ofPhoto(desk, 'Mask parts', name).click();
  await desk.page.waitForSelector('.mask-dialog[open]');
}
async function save(desk, name) {
  await dialogOf(desk).getByRole('button', {name: 'Save'}).click();
  await desk.page.waitForSelector('.mask-dialog', {state: 'detached'});
  await desk.page.waitForFunction(
    id => document.activeElement?.id === id && document.querySelector('.tile-mask'),
    `mask ${name}`,
  );
}

await runAll({
  async 'a photo is turned, two are masked, and both reach the training'(browser) {
    cpSync(join(scene, 'images'), photos, {recursive: true});
    const before = bytesOfPhotos();
    const desk = new Desk(browser, 'turned', withColmap());
    await desk.open();
    await typeFolder(desk, photos);
    await desk.finishJob('doctor', {kills: 0});
    await ofPhoto(desk, 'Turn right', TURNED).click();
    await ofPhoto(desk, 'Turn right', TURNED).click();
    await desk.page.waitForFunction(
      name => document.querySelector(`img[src*="${name}&turn=180"]`)?.naturalWidth > 0,
      TURNED,
    );

    await openMask(desk, TURNED);
    await paint(desk, [0.1, 0.1], [0.3, 0.1]); // on the turned photo
    await save(desk, TURNED);
    await openMask(desk, MASKED);
    await paint(desk, [0.5, 0.2], [0.5, 0.8]);
    await paint(desk, [0.8, 0.2], [0.9, 0.2]);
    await desk.page.keyboard.press('Control+z'); // the second line
    await desk.page.keyboard.press('s');
    await paint(desk, [0.5, 0.5], [0.5, 0.5]);
    await desk.shot('mask');
    await desk.page.keyboard.press('Escape');
    await dialogOf(desk).getByText('This is not saved').waitFor();
    await save(desk, MASKED);
    await desk.page.getByText('2 photos have masked parts').waitFor();

    await desk.killAndComeBack();
    await desk.page.waitForSelector('.tile-mask');
    assert.deepEqual(projectOf(desk.folder, desk.id).turned, {[TURNED]: 180});
    const stored = (name, x, y) => brightnessAt(desk, fileOf(desk, `masks/${name}.png`), x, y);
    assert.equal(await stored(MASKED, 0.5, 0.3), 0);
    assert.equal(await stored(MASKED, 0.5, 0.5), 1); // was shown again
    assert.equal(await stored(MASKED, 0.85, 0.2), 1); // was undone
    assert.equal(await stored(TURNED, 0.8, 0.9), 0); // as the pixels of the photo lie
    assert.equal(await stored(TURNED, 0.2, 0.1), 1);
    await openMask(desk, MASKED); // what was saved is shown
    const shown = await desk.page.evaluate(() => {
      const canvas = document.querySelector('.paint canvas');
      return canvas.getContext('2d').getImageData(canvas.width / 2, 0.3 * canvas.height, 1, 1)
        .data[3];
    });
    assert.equal(shown, 255);
    await desk.page.keyboard.press('Escape');
    await desk.page.waitForSelector('.mask-dialog', {state: 'detached'});
    await desk.shot('turned');

    await desk.step('Cameras');
    await desk.page.getByRole('button', {name: 'Find the cameras'}).click();
    await desk.page.waitForSelector('.job');
    const {id, words} = await desk.finishJob('reconstruct', {kills: 0});
    assert.equal(words[1], `chosen-${id}`);
    const ofScene = name => fileOf(desk, `scene-${id}/images/${name}`);
    for (const [x, y] of [
      [0.2, 0.3],
      [0.7, 0.6],
    ]) {
      const thumb = `p/${encodeURIComponent(desk.id)}/thumb?name=${TURNED}&large=1`;
      const difference =
        (await brightnessAt(desk, ofScene(TURNED), 1 - x, 1 - y)) -
        (await brightnessAt(desk, thumb, x, y));
      assert.ok(Math.abs(difference) < 0.05, `${difference}`); // two JPEGs
    }

    await desk.step('Train');
    await chooseSmallRun(desk, 20);
    await desk.page.getByRole('button', {name: 'Start'}).click();
    await desk.page.waitForSelector('.job');
    const run = await desk.finishJob('train', {kills: 0}),
      ofRun = name => fileOf(desk, `masks-${run.id}/${name}.png`);
    assert.match(run.words.join(' '), new RegExp(` --masks \\.\\./masks-${run.id}$`));
    assert.equal(await brightnessAt(desk, ofRun(TURNED), 0.2, 0.1), 0); // as in the scene
    assert.equal(await brightnessAt(desk, ofRun(MASKED), 0.5, 0.3), 0);

    await desk.step('Photos');
    await openMask(desk, MASKED);
    await dialogOf(desk).getByRole('button', {name: 'Clear'}).click();
    await save(desk, MASKED);
    await desk.page.getByText('1 photo has masked parts').waitFor();
    assert.equal(await desk.page.getByText('find the cameras again').count(), 0);
    await ofPhoto(desk, 'Turn right', 'view_004.jpg').click();
    await desk.page.getByText('find the cameras again').waitFor();
    assert.ok(!existsSync(join(desk.folder, desk.id, 'masks', `${MASKED}.png`)));
    assert.deepEqual(bytesOfPhotos(), before);
    await desk.close();
  },

  async 'the brush works with a finger and with keys, and fits a phone, dark and light'(browser) {
    const desk = new Desk(browser, 'turned');
    desk.id = readdirSync(desk.folder).find(name =>
      existsSync(join(desk.folder, name, 'project.json')),
    );
    await desk.open(`p=${desk.id}&s=photos`);
    const {page} = desk,
      session = await browser.context.newCDPSession(page);
    await ofPhoto(desk, 'Mask parts', MASKED).focus();
    await page.keyboard.press('Enter');
    await page.waitForSelector('.mask-dialog[open]');
    const box = await page.locator('.paint canvas').boundingBox(),
      touch = (type, ...places) =>
        session.send('Input.dispatchTouchEvent', {
          type,
          touchPoints: places.map(([x, y]) => ({
            x: box.x + x * box.width,
            y: box.y + y * box.height,
          })),
        });
    const hidden = () =>
      page.evaluate(() => {
        const canvas = document.querySelector('.paint canvas'),
          copy = Object.assign(document.createElement('canvas'), {
            width: canvas.width,
            height: canvas.height,
          }),
          pen = copy.getContext('2d');
        pen.drawImage(canvas, 0, 0);
        const {data} = pen.getImageData(0, 0, canvas.width, canvas.height);
        return data.filter((value, i) => i % 4 === 3 && value > 127).length;
      });
    const paintByFinger = async y => {
      await touch('touchStart', [0.2, y]);
      for (const x of [0.3, 0.4, 0.5]) await touch('touchMove', [x, y]);
      await touch('touchEnd');
      return hidden();
    };
    const thin = await paintByFinger(0.3);
    for (let i = 0; i < 6; ++i) await page.keyboard.press(']');
    const both = await paintByFinger(0.6);
    assert.ok(thin > 0 && both > 2.5 * thin, `${thin} and ${both} pixels are hidden`);
    await page.keyboard.press('Control+z');
    // A stroke in one piece and in several ones differs in a few pixels of its edge.
    assert.ok(Math.abs((await hidden()) - thin) < 0.01 * thin, 'the thin line alone is left');
    await page.keyboard.press('Escape');
    await page.keyboard.press('Escape');
    await page.waitForSelector('.mask-dialog', {state: 'detached'});
    assert.equal(await page.evaluate(() => document.activeElement.id), `mask ${MASKED}`);

    for (const colorScheme of ['dark', 'light'])
      for (const [name, width, height] of [
        ['phone', 390, 844],
        ['desk', 1280, 800],
      ]) {
        await desk.openPage(`p=${desk.id}&s=photos`, {width, height, colorScheme});
        await desk.page.locator('.grid').scrollIntoViewIfNeeded();
        await desk.page.waitForFunction(
          () =>
            [...document.querySelectorAll('.tile img')].filter(img => img.naturalWidth).length > 3,
        );
        await desk.shot(`tiles-${name}-${colorScheme}`);
        await openMask(desk, TURNED);
        await desk.shot(`mask-${name}-${colorScheme}`);
        const wide = await desk.page.evaluate(() => document.documentElement.scrollWidth);
        assert.ok(wide <= width, `the screen is ${wide} pixels wide`);
        const {x, y, width: w, height: h} = await desk.page.locator('.paint').boundingBox();
        assert.ok(x >= 0 && y >= 0 && x + w <= width && y + h <= height, `${x} ${y} ${w} ${h}`);
      }
    await desk.close();
  },
});
