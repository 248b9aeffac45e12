// SPDX-License-Identifier: Apache-2.0
// A headless Chromium that reaches nothing but the files it is given, and remembers what went wrong.
import {mkdtemp, rm} from 'node:fs/promises';
import {createRequire} from 'node:module';
import {tmpdir} from 'node:os';
import {join, resolve} from 'node:path';
import {pathToFileURL} from 'node:url';

const FLAGS = ['--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
               '--disable-background-networking', '--disable-component-update', '--disable-sync'];

export class Browser {
  // modules: the folder that holds node_modules; executable: Chromium's
  static async start(modules, executable) {
    const {chromium} = createRequire(join(resolve(modules), 'package.json'))('playwright-core');
    const profile = await mkdtemp(join(tmpdir(), 'gemsplat-browser-'));
    const context = await chromium.launchPersistentContext(profile, {executablePath: executable, args: FLAGS, offline: true});
    return new Browser(context, profile);
  }
  constructor(context, profile) {
    this.context = context;
    this.profile = profile;
    this.failures = [];
  }

  // Opens a file. Any request for something else, and anything that the page complains about, is a failure.
  async open(file, {width = 1280, height = 900, colorScheme = 'light', touch = false} = {}) {
    const url = pathToFileURL(resolve(file)).href;
    const page = await this.context.newPage();
    await page.setViewportSize({width, height});
    await page.emulateMedia({colorScheme, reducedMotion: 'reduce'});
    const fail = text => this.failures.push(`${file}: ${text}`);
    page.on('console', message => {
      if (['error', 'warning'].includes(message.type())) fail(`console: ${message.text()}`);
    });
    page.on('pageerror', error => fail(`error: ${error.message}`));
    page.on('dialog', dialog => { fail(`dialog: ${dialog.message()}`); dialog.dismiss(); });
    page.on('request', request => {
      if (request.url().split('#')[0] !== url && !request.url().startsWith('data:')) fail(`request: ${request.url()}`);
    });
    await page.goto(url);
    await page.waitForFunction(() => document.querySelector('h1') || document.querySelector('.failure'));
    await page.waitForTimeout(300);  // charts are drawn when their places are known
    return page;
  }

  async close() {
    await this.context.close();
    await rm(this.profile, {recursive: true, force: true});
  }
}
