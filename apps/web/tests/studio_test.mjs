// SPDX-License-Identifier: Apache-2.0
// The studio in a browser: from photos to a model, an edit, a film and files, while the studio is
// killed on the way; uploads and a stand-in for COLMAP; phones, keyboards and dark screens.
// studio_desk.mjs has the command line.
import assert from 'node:assert/strict';
import {existsSync, readdirSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';
import {psnr} from './pictures.mjs';
import {
  Desk,
  STEPS,
  chooseSmallRun,
  out,
  pause,
  projectOf,
  resultsOf,
  runAll,
  scene,
  typeFolder,
  withColmap,
} from './studio_desk.mjs';

const KILLS = 10; // on the way from photos to files

const tests = {
  async 'from photos with cameras to a film, while the studio is killed'(browser) {
    const desk = new Desk(browser, 'killed');
    await desk.open();
    await desk.shot('start');
    await typeFolder(desk, scene);
    await desk.finishJob('doctor');
    await desk.page.waitForSelector('.findings');
    await desk.shot('photos');

    await desk.step('Cameras');
    await desk.page.getByText('Cameras are known').waitFor();
    await desk.step('Train');
    await chooseSmallRun(desk, STEPS);
    await desk.page.getByRole('button', {name: 'Start'}).click();
    await desk.page.waitForSelector('.job');
    const run = await desk.finishJob('train', {kills: 5, within: 2000});
    assert.equal(resultsOf(desk, run).iterations, STEPS);

    await desk.openPage(`p=${desk.id}&s=clean`);
    await desk.page.waitForSelector('.viewer iframe:not([hidden])');
    await desk.page.locator('.operation', {hasText: 'Faint'}).getByText('Count').click();
    await desk.page.getByText(/Gaussians remain/).waitFor();
    await desk.page.locator('.operation', {hasText: 'Faint'}).getByText('Apply').click();
    await desk.page.waitForSelector('.job');
    const edit = await desk.finishJob('edit', {within: 100});
    assert.ok(existsSync(join(desk.folder, desk.id, `edits/${edit.id}.ply`)));
    await desk.openPage(`p=${desk.id}&s=clean`);
    await desk.page.waitForSelector('.viewer iframe:not([hidden])');
    const shown = () => projectOf(desk.folder, desk.id).model;
    await desk.page.getByRole('button', {name: 'Undo'}).click();
    await desk.page.waitForFunction(
      () => !document.querySelector('.side .buttons button:nth-child(2)').disabled,
    );
    assert.equal(shown(), run.words[3]);
    await desk.page.waitForSelector('.viewer iframe:not([hidden])');
    const first = await (await desk.page.$('.viewer iframe')).contentFrame();
    await first.waitForFunction(() => window.gemsplatViewer?.ready.then(() => true));
    await desk.page.focus('.viewer iframe'); // a key that is pressed in the picture counts, too
    await desk.page.keyboard.press('Control+Shift+Z');
    await desk.page.waitForFunction(
      () => !document.querySelector('.side .buttons button').disabled,
    );
    assert.match(shown(), /^edits\//);

    const frame = await (await desk.page.$('.viewer iframe')).contentFrame();
    await frame.waitForFunction(() =>
      window.gemsplatViewer?.ready.then(() => gemsplatViewer.settled()).then(() => true),
    );
    const {x, y, width, height} = await (await desk.page.$('.viewer iframe')).boundingBox(),
      [left, top] = [Math.ceil(x), Math.ceil(y)],
      clip = {x: left, y: top, width: Math.floor(width) - 1, height: Math.floor(height) - 1};
    const picture = async () => {
      await desk.page.evaluate(() => scrollTo(0, 0)); // a click has moved the page
      await frame.waitForFunction(() => gemsplatViewer.settled().then(() => true));
      return desk.page.screenshot({clip});
    };
    const all = await picture(),
      size = desk.page.locator('.operation', {hasText: 'Large'});
    await size.locator('input').fill('0.02');
    await frame.waitForTimeout(100);
    const small = await psnr(desk.page, all, await picture());
    await desk.shot('filter');
    await size.getByText('Show all').click();
    await frame.waitForTimeout(100);
    const again = await psnr(desk.page, all, await picture());
    assert.ok(small < 15 && again > 30, `a filter left ${small} dB, and no filter ${again} dB`);

    const card = desk.page.locator('section.card', {hasText: 'Click corners around'});
    await card.getByText('Show the tool').click();
    const place = await (await desk.page.$('.viewer iframe')).boundingBox();
    for (const [x, y] of [
      [0.3, 0.6],
      [0.5, 0.6],
      [0.5, 0.8],
      [0.3, 0.8],
    ])
      await desk.page.mouse.click(place.x + x * place.width, place.y + y * place.height);
    const edits = shown();
    await desk.page.keyboard.press('Control+z'); // takes back the last corner, and no edit
    await frame.waitForFunction(() =>
      gemsplatViewer.lasso().then(({file}) => file.line.length === 3),
    );
    assert.equal(shown(), edits);
    await desk.page.mouse.click(place.x + 0.3 * place.width, place.y + 0.8 * place.height);
    await desk.shot('lasso');
    await card.getByText('Apply').click();
    await desk.page.waitForFunction(
      () => gemsplatStudio.project.jobs.filter(({words}) => words[0] === 'edit').length === 2,
    );
    const lasso = await desk.finishJob('edit', {kills: 0});
    assert.ok(lasso.words.some(word => /^lasso=tools/.test(word)));
    const [{before, after}] = (
      await desk.page.evaluate(id => gemsplatStudio.server.said(id), lasso.id)
    ).outcome.steps;
    assert.ok(after < before && after > 0.5 * before, `${after} of ${before} remain`);
    await desk.page.waitForFunction(
      name =>
        gemsplatStudio.details.model === `edits/${name}` &&
        document.querySelector('.viewer iframe')?.contentDocument.title.startsWith(name),
      `${lasso.id}.ply`,
    );

    const edited = await (await desk.page.$('.viewer iframe')).contentFrame();
    await edited.waitForFunction(() =>
      window.gemsplatViewer?.ready.then(() => gemsplatViewer.settled()).then(() => true),
    );
    await card.getByText('Show the tool').click();
    await edited.getByRole('button', {name: 'Brush L'}).click();
    const at = (x, y) => [place.x + x * place.width, place.y + y * place.height];
    await desk.page.mouse.move(...at(0.55, 0.6));
    await desk.page.mouse.down();
    for (const x of [0.58, 0.62, 0.66]) await desk.page.mouse.move(...at(x, 0.65));
    await desk.page.mouse.up();
    await desk.shot('brush');
    await card.getByText('Count').click();
    await desk.page.waitForFunction(() =>
      /remain/.test(document.querySelector('.side > .said').textContent),
    );
    const counts = (await desk.page.locator('.side > .said').innerText()).match(/[\d,]+/g);
    const [rest, whole] = counts.map(count => Number(count.replaceAll(',', '')));
    assert.ok(rest < whole && rest > 0.5 * whole, `${rest} of ${whole} remain`);

    await desk.step('Film');
    await desk.page.selectOption('#size', '640x360');
    await desk.page.fill('#seconds', '1');
    await desk.page.getByRole('button', {name: 'Circle around'}).click();
    await desk.page.waitForSelector('.job');
    await desk.finishJob('render', {within: 800});
    await desk.openPage(`p=${desk.id}&s=film`);
    await desk.page.waitForFunction(() => document.querySelector('video')?.duration > 0.5);
    await desk.shot('film');

    await desk.step('Share');
    await desk.page.getByRole('button', {name: 'Write these'}).click();
    await desk.page.waitForSelector('.job');
    const written = await desk.finishJob('export', {kills: 2, within: 400});
    await desk.openPage(`p=${desk.id}&s=share`);
    await desk.page.waitForSelector('.job table');
    assert.match(await desk.page.locator('.job table').innerText(), /\.spz[\s\S]*dB/);
    await desk.shot('share');
    for (const file of written.words.filter(word => word.startsWith('share/')))
      assert.ok(existsSync(join(desk.folder, desk.id, file)), file);
    const jobsBefore = desk.jobs.length;
    await desk.page.fill('#turn-x', '-90');
    await desk.page.fill('#scale', '2');
    await desk.page.getByRole('button', {name: 'Write these'}).click();
    await desk.page.waitForFunction(
      count => gemsplatStudio.project.jobs.length === count + 2,
      jobsBefore,
    );
    const moved = await desk.finishJob('export', {kills: 0});
    assert.match(moved.words[1], /placed\.ply$/);
    assert.match(
      desk.jobs.at(-2).words.join(' '),
      / --turn -90,0,0 --scale 2 -o share\/\d+\/placed\.ply$/,
    );
    await desk.page.getByRole('button', {name: 'Write a mesh'}).click();
    await desk.page.waitForFunction(
      count => gemsplatStudio.project.jobs.length === count + 3,
      jobsBefore,
    );
    const mesh = await desk.finishJob('mesh', {kills: 0});
    assert.ok(existsSync(join(desk.folder, desk.id, mesh.words.at(-1).replace('{id}', mesh.id))));
    await desk.page.getByText(/ triangles\./).waitFor();
    assert.equal(desk.kills, KILLS);
    console.log(
      `        ${KILLS} kills of the studio, ${desk.killsOfJobs} of them while a job ran`,
    );
    await desk.close();
  },

  async 'photos are dropped, checked, left out, and placed'(browser) {
    const desk = new Desk(browser, 'dropped', withColmap());
    await desk.open();
    const photos = readdirSync(join(scene, 'images')).map(name => join(scene, 'images', name));
    await desk.page.locator('input[type=file]').first().setInputFiles(photos);
    await desk.page.waitForSelector('.step[aria-current]');
    desk.id = readdirSync(desk.folder).find(name =>
      existsSync(join(desk.folder, name, 'project.json')),
    );
    await desk.finishJob('doctor', {kills: 0});
    assert.equal(readdirSync(join(desk.folder, desk.id, 'input')).length, photos.length);
    await desk.page.locator('.tile').nth(3).click();
    await desk.page.getByText(`${photos.length - 1} of ${photos.length} photos are used`).waitFor();
    const [left] = projectOf(desk.folder, desk.id).left_out;

    await desk.step('Cameras');
    await desk.page.getByRole('button', {name: 'Find the cameras'}).click();
    await desk.page.waitForSelector('.job');
    const job = await desk.finishJob('reconstruct', {within: 300});
    const placed = readdirSync(join(desk.folder, desk.id, `scene-${job.id}`, 'images'));
    assert.ok(!placed.includes(left) && placed.length === photos.length - 1);
    await desk.openPage(`p=${desk.id}&s=train`);
    await desk.page.waitForSelector('.preset');
    await desk.close();
  },

  async 'a file that cannot be taken is a line on the page, and nothing is lost'(browser) {
    const desk = new Desk(browser, 'dropped');
    await desk.open();
    const zip = join(out, 'broken.zip');
    writeFileSync(zip, 'PK, but no archive');
    await desk.page.locator('input[type=file]').first().setInputFiles([zip]);
    await desk.page
      .getByText(/broken\.zip.*zip archive/)
      .first()
      .waitFor();
    desk.browser.failures.length = 0; // the browser notes the answer 400
    await desk.page.getByText('Drop more photos here').waitFor();
    await desk.close();
  },

  async 'a click counts whatever is shown anew meanwhile, and a lost answer is asked for again'(
    browser,
  ) {
    const desk = new Desk(browser, 'press');
    await desk.open();
    await typeFolder(desk, scene);
    await desk.finishJob('doctor', {kills: 0});
    const {page} = desk;
    await page.locator('.step', {hasText: 'Train'}).hover();
    await page.mouse.down();
    await page.evaluate(() => void gemsplatStudio.reload());
    await pause(1000);
    await page.mouse.up();
    await page.waitForFunction(() => document.title.endsWith('Train'));
    await page.route('**/p/*/', route => route.abort(), {times: 1});
    await desk.step('Share');
    await desk.close();
  },

  async 'every screen fits a phone, is dark where the system is, and works with keys'(browser) {
    const desk = new Desk(browser, 'killed');
    desk.id = readdirSync(join(out, 'killed')).find(name => !name.startsWith('.'));
    await desk.open('', {width: 390, height: 844, colorScheme: 'dark'});
    for (const screen of ['start', 'photos', 'cameras', 'train', 'clean', 'film', 'share']) {
      await desk.openPage(screen === 'start' ? '' : `p=${desk.id}&s=${screen}`, {
        width: 390,
        height: 844,
        colorScheme: 'dark',
      });
      await pause(800);
      await desk.page.screenshot({path: join(out, `phone-${screen}.png`)});
      const wide = await desk.page.evaluate(() => document.documentElement.scrollWidth);
      assert.ok(wide <= 390, `${screen} is ${wide} pixels wide`);
    }
    await desk.openPage(`p=${desk.id}&s=photos`);
    for (let i = 0; i < 8; ++i) {
      await desk.page.keyboard.press('Tab');
      if ((await desk.page.evaluate(() => document.activeElement.textContent)) === 'Train') break;
    }
    await desk.page.keyboard.press('Enter');
    await desk.page.waitForFunction(() => document.title.endsWith('Train'));
    await desk.close();
  },
};

await runAll(tests);
