// SPDX-License-Identifier: Apache-2.0
// The studio in two browsers: runs of two projects at the same time, which are stopped; a project
// is renamed and removed. studio_desk.mjs has the command line.
import assert from 'node:assert/strict';
import {existsSync} from 'node:fs';
import {join} from 'node:path';
import {
  Desk,
  check,
  chooseSmallRun,
  newestCheckpoint,
  runAll,
  scene,
  startBrowser,
  typeFolder,
} from './studio_desk.mjs';

// Steps, so that neither run ends while the other one begins on a busy machine.
const LONG = 100_000;
const isAboutRemoval = text => text.includes('status of 400'); // there is no such project

// Stops the run of the page, which is saved.
async function stopRun(desk) {
  await desk.page.getByRole('button', {name: 'Stop'}).click();
  await desk.page.locator('.job[data-state="stopped"]').waitFor();
  const {state, words} = desk.jobs.at(-1);
  assert.equal(state, 'stopped');
  assert.ok(newestCheckpoint(join(desk.folder, desk.id, words[3])) > 0);
}

await runAll({
  async 'two projects train at once from two browsers; they are stopped; one is renamed and removed'(
    browser,
  ) {
    const second = await startBrowser();
    const desks = [new Desk(browser, 'two'), new Desk(second, 'two')],
      [desk, other] = desks;
    await desk.open();
    other.studio = desk.studio;
    await other.openPage();
    for (const each of desks) {
      await typeFolder(each, scene);
      await each.finishJob('doctor', {kills: 0});
      await each.step('Train');
      await chooseSmallRun(each, LONG);
    }
    assert.notEqual(desk.id, other.id);
    // The forecast of the second run is some terabytes, which its card says; the run is small.
    await other.page.locator('.settings summary').click();
    await other.page.selectOption('[id="setting-density.strategy"]', 'mcmc');
    await other.page.fill('[id="setting-density.max_gaussians"]', '2000000000');
    await other.page.getByText('All settings, 2 changed').waitFor();
    for (const each of desks) {
      await each.page.getByRole('button', {name: 'Start'}).click();
      await each.step('Photos'); // where no viewer slows the page down
    }
    const {words} = other.jobs.at(-1);
    for (const setting of ['density.strategy=mcmc', 'density.max_gaussians=2000000000'])
      assert.ok(words.includes(setting), words.join(' '));
    // Each page sees both runs take steps while both run.
    const takeSteps = () => {
      const steps = gemsplatStudio.state.projects.map(({jobs}) => {
        const {state, progress} = jobs.at(-1);
        return state === 'running' && progress?.unit === 'step' ? progress.done : NaN;
      });
      if (steps.some(Number.isNaN)) return false;
      window.firstSteps ??= steps;
      return steps.every((step, i) => step > window.firstSteps[i]);
    };
    await Promise.all(desks.map(({page}) => page.waitForFunction(takeSteps, null, {polling: 100})));
    for (const each of desks) {
      await each.step('Train');
      await each.page.getByText(/it shares this machine with courtyard/).waitFor();
    }
    await other.page
      .locator('.job[data-state="running"] .warnings', {hasText: 'may need'})
      .waitFor();
    // The screen was made anew when its run began, and settings are as they were typed.
    assert.equal(
      await other.page.locator('.settings summary').textContent(),
      'All settings, 2 changed',
    );
    assert.equal(await other.page.inputValue('[id="setting-density.strategy"]'), 'mcmc');
    await desk.shot('two');
    await other.shot('other');
    for (const each of desks) await stopRun(each);
    for (const each of desks) await each.step('Photos');

    const settings = desk.page.locator('.project-settings');
    await settings.locator('summary').click();
    await desk.page.fill('#project-name', 'At noon');
    await settings.getByText('Rename', {exact: true}).click();
    await desk.page.waitForFunction(() => document.title.startsWith('At noon'));
    await other.openPage();
    await other.page.getByText('At noon').waitFor();
    await settings.locator('summary').click();
    await settings.getByText('Remove the project').click();
    await desk.shot('remove');
    await settings.getByText('Keep it').click();
    await settings.getByText('Remove the project').click();
    await settings.getByText('Remove it').click();
    await desk.page.getByText(/At noon was moved to .*removed/).waitFor();
    await desk.shot('removed');
    await other.page.waitForFunction(() => gemsplatStudio.state.projects.length === 1);
    await other.page.getByText('At noon').waitFor({state: 'detached'});
    assert.ok(existsSync(join(desk.folder, 'removed', desk.id, 'run-2', 'checkpoints')));
    await other.page.close();
    await desk.close();
    for (const each of [browser, second])
      each.failures = each.failures.filter(text => !isAboutRemoval(text));
    check(second);
    await second.close();
  },
});
