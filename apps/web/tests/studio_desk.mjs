// SPDX-License-Identifier: Apache-2.0
// The studio and its page for the tests in a browser, which are started so:
//   node studio_test.mjs MODULES PROGRAM SCENE OUT CHROMIUM
// SEED=N in the environment repeats the moments at which the studio is killed.
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

export const [modules, program, scene, out] = process.argv.slice(2, 6).map(path => resolve(path)),
  chromium = findChromium(process.argv[6]);
const SEED = Number(process.env.SEED ?? Date.now() % 100_000);
export const STEPS = 400;
const LONGEST = 90_000, // milliseconds for a job
  LONGEST_WAIT = 60_000; // and for what a page is to show

let random = SEED;
// 0 to 1: the same for the same SEED.
const chance = () => (random = (random * 48271 + 11) % 2147483647) / 2147483647;
export const pause = time => new Promise(done => setTimeout(done, time));

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

/// The environment of a studio whose COLMAP finds the cameras of the scene at once.
export function withColmap() {
  const stand = join(out, 'colmap');
  mkdirSync(stand, {recursive: true});
  writeFileSync(
    join(stand, 'colmap'),
    `#!/bin/sh\n[ "$1 $2" = 'mapper --database_path' ] || exit 0\n` +
      `while [ "$1" != --output_path ]; do shift; done\ncp -r '${join(scene, 'sparse', '0')}' "$2/0"\n`,
  );
  chmodSync(join(stand, 'colmap'), 0o755);
  return {PATH: `${stand}:${process.env.PATH}`};
}

export const projectOf = (folder, id) =>
  JSON.parse(readFileSync(join(folder, id, 'project.json'), 'utf8'));
// What a page says whose studio was killed, or whose run has ended with its live view.
const isAboutTheEnd = text =>
  /status of (404|502)|net::ERR_|The server does not answer|this run does not show itself|this view has ended/.test(
    text,
  );

/// The step of the newest checkpoint of a run; 0: there is none.
export function newestCheckpoint(run) {
  const folder = join(run, 'checkpoints'),
    names = existsSync(folder) ? readdirSync(folder) : [];
  return Math.max(0, ...names.map(name => Number(name.match(/^step_(\d+)\.ckpt$/)?.[1] ?? 0)));
}

// The studio and its page, which both can end and begin again at any time.
export class Desk {
  constructor(browser, name, env = {}) {
    Object.assign(this, {browser, env, folder: join(out, name)});
    this.kills = this.killsOfJobs = 0;
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

  // Waits until the newest job is done. The studio is killed so many times on the way, or after it
  // where the job was faster; the job's button goes on, and no step of a run is done twice.
  async finishJob(verb, {kills = 1, within = 1500} = {}) {
    const deadline = Date.now() + LONGEST,
      count = this.jobs.length;
    let shownStep = 0;
    const isVerb = job => job?.words[0] === verb;
    for (;;) {
      const job = this.jobs.at(-1);
      assert.ok(isVerb(job), `the newest job is ${job?.words}`);
      assert.equal(this.jobs.length, count, 'no job is lost, and none is made twice');
      if (job.state === 'done') {
        for (; kills > 0; --kills) {
          await pause(within * chance());
          await this.killAndComeBack();
        }
        return job;
      }
      assert.notEqual(job.state, 'failed', job.message);
      assert.ok(Date.now() < deadline, `${verb} is ${job.state} for too long`);
      if (kills > 0 && job.state === 'running') {
        --kills;
        await pause(within * chance());
        const progress = await this.page.evaluate(
          () => gemsplatStudio.project.jobs.at(-1)?.progress,
        );
        if (progress?.unit === 'step') shownStep = progress.done;
        if (this.jobs.at(-1).state === 'running') ++this.killsOfJobs;
        await this.killAndComeBack();
      } else if (job.state === 'interrupted') {
        if (verb === 'train') {
          const saved = newestCheckpoint(join(this.folder, this.id, job.words[3]));
          assert.ok(saved >= shownStep, `step ${shownStep} was shown, and step ${saved} was saved`);
        }
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

export const typeFolder = async (desk, folder) => {
  await desk.page.fill('#folder', folder);
  await desk.page.keyboard.press('Enter');
  await desk.page.waitForSelector('.step[aria-current]');
  desk.id = decodeURIComponent(new URL(desk.page.url()).hash.match(/p=([^&]*)/)[1]);
};

// Fills in the form of the screen Train.
export async function chooseSmallRun({page}, steps) {
  await page.fill('#steps', String(steps));
  await page.fill('#width', '96');
  await page.getByRole('button', {name: 'Small'}).click();
}
export const resultsOf = (desk, run) =>
  JSON.parse(readFileSync(join(desk.folder, desk.id, run.words[3], 'results.json'), 'utf8'));

export const check = ({failures}) =>
  assert.deepEqual(
    failures.filter(text => !isAboutTheEnd(text)),
    [],
  );

/// A browser whose pages have the time that a busy machine takes.
export async function startBrowser() {
  const browser = await Browser.start(modules, chromium, {server: true});
  browser.context.setDefaultTimeout(LONGEST_WAIT);
  return browser;
}

/// Empties the folder OUT, runs the tests in it, and ends the process.
export async function runAll(tests) {
  rmSync(out, {recursive: true, force: true});
  mkdirSync(out, {recursive: true});
  const browser = await startBrowser();
  finish(
    await browser.runTests(tests, {check: () => check(browser)}),
    `SEED=${SEED}; screenshots: ${out}`,
  );
}
