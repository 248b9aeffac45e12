// SPDX-License-Identifier: Apache-2.0
// The studio in two browsers: runs of two projects at the same time; a project is renamed and removed.
// studio_desk.mjs has the command line.
import assert from 'node:assert/strict';
import {existsSync} from 'node:fs';
import {join} from 'node:path';
import {
  Desk,
  STEPS,
  check,
  chooseSmallRun,
  resultsOf,
  runAll,
  scene,
  startBrowser,
  typeFolder,
} from './studio_desk.mjs';

const isAboutRemoval = text => text.includes('status of 400'); // there is no such project

await runAll({
  async 'two projects train at once from two browsers; one is renamed and removed'(browser) {
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
      await chooseSmallRun(each, 2 * STEPS);
    }
    assert.notEqual(desk.id, other.id);
    // The forecast of the second run is some terabytes, which its card says; the run is small.
    await other.page.locator('.settings summary').click();
    await other.page.selectOption('[id="setting-density.strategy"]', 'mcmc');
    await other.page.fill('[id="setting-density.max_gaussians"]', '2000000000');
    for (const {page} of desks) await page.getByRole('button', {name: 'Start'}).click();
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
    for (const each of desks) await each.step('Photos'); // where no viewer slows the page down
    await Promise.all(desks.map(({page}) => page.waitForFunction(takeSteps, null, {polling: 100})));
    for (const each of desks) {
      await each.step('Train');
      await each.page.getByText(/it shares this machine with courtyard/).waitFor();
    }
    await other.page
      .locator('.job[data-state="running"] .warnings', {hasText: 'may need'})
      .waitFor();
    await desk.shot('two');
    for (const each of desks) await each.step('Photos');
    for (const each of desks) {
      const run = await each.finishJob('train', {kills: 0});
      assert.equal(resultsOf(each, run).iterations, 2 * STEPS);
    }

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
    assert.ok(existsSync(join(desk.folder, 'removed', desk.id, 'run-2', 'results.json')));
    await other.page.close();
    await desk.close();
    for (const each of [browser, second])
      each.failures = each.failures.filter(text => !isAboutRemoval(text));
    check(second);
    await second.close();
  },
});
