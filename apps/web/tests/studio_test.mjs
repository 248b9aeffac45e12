// SPDX-License-Identifier: Apache-2.0
// The studio in a browser: from photos to a model, an edit, a film and files, while the studio is
// killed on the way; uploads and a stand-in for COLMAP; phones, keyboards and dark screens.
//   node studio_test.mjs MODULES PROGRAM SCENE OUT CHROMIUM
// SEED=N in the environment repeats the moments at which it is killed.
import assert from 'node:assert/strict';
import {spawn} from 'node:child_process';
import {
  chmodSync,
  existsSync,
  mkdirSync,
  readFileSync,
  readdirSync,
  rmSync,
  writeFileSync,
} from 'node:fs';
import {join, resolve} from 'node:path';
import {Browser, findChromium, finish} from './browser.mjs';

const [modules, program, scene, out] = process.argv.slice(2, 6).map(path => resolve(path)),
  chromium = findChromium(process.argv[6]);
const SEED = Number(process.env.SEED ?? Date.now() % 100_000);
const STEPS = 400,
  LONGEST = 90_000; // milliseconds for a job

let random = SEED;
// 0 to 1: the same for the same SEED.
const chance = () => (random = (random * 48271 + 11) % 2147483647) / 2147483647;
const pause = time => new Promise(done => setTimeout(done, time));

const children = new Set();
process.on('exit', () => children.forEach(child => child.kill('SIGKILL')));

// A studio in the folder: {url, kill(), end()}.
async function startStudio(folder, env = {}) {
  const child = spawn(program, ['studio', folder, '--no-open', '--port', '0'], {
    stdio: ['ignore', 'pipe', 'pipe'],
    env: {...process.env, ...env},
  });
  const ended = new Promise(done => child.on('exit', done));
  children.add(child);
  let said = '';
  const url = await new Promise((done, fail) => {
    const hear = data => {
      said += data;
      const address = said.match(/http:\/\/127\.0\.0\.1:\d+\/[0-9a-f]{32}\/\n/);
      if (address) done(address[0].trim());
    };
    child.stdout.on('data', hear);
    child.stderr.on('data', hear);
    ended.then(code => fail(new Error(`the studio ended with ${code}: ${said}`)));
  });
  const stop = signal => {
    child.kill(signal);
    return ended;
  };
  return {url, kill: () => stop('SIGKILL'), end: () => stop('SIGINT')};
}

const projectOf = (folder, id) =>
  JSON.parse(readFileSync(join(folder, id, 'project.json'), 'utf8'));
// What a page says whose studio was killed, or whose run has ended with its live view.
const isAboutTheEnd = text => /status of (404|502)|net::ERR_|The server does not answer/.test(text);

// The studio and its page, which both can end and begin again at any time.
class Desk {
  constructor(browser, name, env = {}) {
    Object.assign(this, {browser, env, folder: join(out, name)});
    this.kills = 0;
  }
  async open(hash = '', options = {}) {
    this.studio = await startStudio(this.folder, this.env);
    await this.openPage(hash, options);
  }
  async openPage(hash = '', options = {}) {
    await this.page?.close();
    this.page = await this.browser.openServer(this.studio.url, {
      at: hash,
      width: 1280,
      height: 800,
      own: `${new URL(this.studio.url).origin}/`,
      ...options,
    });
    await this.page.waitForSelector('main');
  }
  async killAndComeBack() {
    ++this.kills;
    const hash = new URL(this.page.url()).hash.slice(1);
    await this.studio.kill();
    await this.open(hash);
  }
  async step(title) {
    await this.page.locator('.step', {hasText: title}).click();
    await this.page.waitForFunction(
      name => document.title.endsWith(name) && document.querySelector('main'),
      title,
    );
  }
  async shot(name) {
    await this.page.screenshot({path: join(out, `${name}.png`)});
  }
  get jobs() {
    return projectOf(this.folder, this.id).jobs;
  }

  // Waits until the newest job is done. Where the studio is killed meanwhile, its button goes on.
  async finishJob(verb, {kills = 1, within = 1500} = {}) {
    const deadline = Date.now() + LONGEST,
      count = this.jobs.length;
    const isVerb = job => job?.words[0] === verb;
    for (;;) {
      const job = this.jobs.at(-1);
      assert.ok(isVerb(job), `the newest job is ${job?.words}`);
      assert.equal(this.jobs.length, count, 'no job is lost, and none is made twice');
      if (job.state === 'done') return job;
      assert.notEqual(job.state, 'failed', job.message);
      assert.ok(Date.now() < deadline, `${verb} is ${job.state} for too long`);
      if (kills > 0 && job.state === 'running') {
        --kills;
        await pause(within * chance());
        await this.killAndComeBack();
      } else if (job.state === 'interrupted') {
        const goOn = this.page.getByRole('button', {name: 'Go on'}).first();
        await goOn.click();
        await this.page.waitForFunction(
          () => !document.querySelector('.job[data-state="interrupted"]'),
        );
      }
      await pause(100);
    }
  }
  async close() {
    await this.page.close();
    assert.equal(await this.studio.end(), 0);
  }
}

const typeFolder = async (desk, folder) => {
  await desk.page.fill('#folder', folder);
  await desk.page.keyboard.press('Enter');
  await desk.page.waitForSelector('.step[aria-current]');
  desk.id = decodeURIComponent(new URL(desk.page.url()).hash.match(/p=([^&]*)/)[1]);
};

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
    await desk.page.fill('#steps', String(STEPS));
    await desk.page.fill('#width', '96');
    await desk.page.getByRole('button', {name: 'Small'}).click();
    await desk.page.getByRole('button', {name: 'Start'}).click();
    await desk.page.waitForSelector('.job');
    const run = await desk.finishJob('train', {kills: 3, within: 3000});
    const results = JSON.parse(
      readFileSync(join(desk.folder, desk.id, run.words[3], 'results.json'), 'utf8'),
    );
    assert.equal(results.iterations, STEPS);

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
    await desk.page.keyboard.press('Control+Shift+Z');
    await desk.page.waitForFunction(
      () => !document.querySelector('.side .buttons button').disabled,
    );
    assert.match(shown(), /^edits\//);

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
    const written = await desk.finishJob('export', {within: 400});
    await desk.openPage(`p=${desk.id}&s=share`);
    await desk.page.waitForSelector('.job table');
    assert.match(await desk.page.locator('.job table').innerText(), /\.spz[\s\S]*dB/);
    await desk.shot('share');
    for (const file of written.words.filter(word => word.startsWith('share/')))
      assert.ok(existsSync(join(desk.folder, desk.id, file)), file);
    assert.ok(desk.kills >= 4, `${desk.kills} kills`);
    await desk.close();
  },

  async 'photos are dropped, checked, left out, and placed'(browser) {
    const stand = join(out, 'colmap');
    mkdirSync(stand, {recursive: true});
    writeFileSync(
      join(stand, 'colmap'),
      `#!/bin/sh\n[ "$1 $2" = 'mapper --database_path' ] || exit 0\n` +
        `while [ "$1" != --output_path ]; do shift; done\ncp -r '${join(scene, 'sparse', '0')}' "$2/0"\n`,
    );
    chmodSync(join(stand, 'colmap'), 0o755);
    const desk = new Desk(browser, 'dropped', {PATH: `${stand}:${process.env.PATH}`});
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

rmSync(out, {recursive: true, force: true});
mkdirSync(out, {recursive: true});
const browser = await Browser.start(modules, chromium, {server: true});
browser.context.setDefaultTimeout(60_000);
const check = () =>
  assert.deepEqual(
    browser.failures.filter(text => !isAboutTheEnd(text)),
    [],
  );
finish(await browser.runTests(tests, {check}), `SEED=${SEED}; screenshots: ${out}`);
