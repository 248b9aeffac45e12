// SPDX-License-Identifier: Apache-2.0
// A headless Chromium that reaches nothing but the file or the server it is given, and remembers
// what went wrong.
import assert from 'node:assert/strict';
import {existsSync} from 'node:fs';
import {mkdtemp, rm} from 'node:fs/promises';
import {createRequire} from 'node:module';
import {tmpdir} from 'node:os';
import {delimiter, join, resolve} from 'node:path';
import {pathToFileURL} from 'node:url';

const FLAGS = [
  '--headless',
  '--no-sandbox',
  '--disable-quic',
  '--no-first-run',
  '--disable-background-networking',
  '--disable-component-update',
  '--disable-sync',
];
const WITHOUT_3D = ['--disable-gpu'];
const WITH_3D = [
  '--use-angle=swiftshader',
  '--enable-unsafe-swiftshader',
  '--ignore-gpu-blocklist',
]; // drawn by the CPU
const THIS_MACHINE_ONLY = [
  '--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1',
  '--proxy-server=direct://',
];

const SKIPPED = 77; // as CTest is told

// The file of that name, or the first Chromium on the PATH where none is named. Without one the test
// is skipped, and says so.
export function findChromium(named) {
  const programs = ['chromium', 'chromium-browser', 'google-chrome'];
  const found = named
    ? [named]
    : process.env.PATH.split(delimiter).flatMap(folder => programs.map(name => join(folder, name)));
  const chromium = found.find(file => existsSync(file));
  if (chromium) return chromium;
  console.log('skipped: no Chromium was found; install the package chromium');
  process.exit(SKIPPED);
}

// Tests read pixels, for which the driver waits; on a busy machine it says so.
const isAboutReading = text =>
  text.includes('GL Driver Message (OpenGL, Performance') && text.includes('ReadPixels');

export class Browser {
  // modules: the folder that holds node_modules; executable: Chromium's; for pages of a server,
  // with WebGL: {server: true}
  static async start(modules, executable, {server = false} = {}) {
    const {chromium} = createRequire(join(resolve(modules), 'package.json'))('playwright-core');
    const profile = await mkdtemp(join(tmpdir(), 'gemsplat-browser-'));
    const args = [...FLAGS, ...(server ? [...WITH_3D, ...THIS_MACHINE_ONLY] : WITHOUT_3D)];
    const context = await chromium.launchPersistentContext(profile, {
      executablePath: executable,
      args,
      offline: !server,
    });
    return new Browser(context, profile);
  }
  constructor(context, profile) {
    this.context = context;
    this.profile = profile;
    this.failures = [];
  }

  // Opens a page; `before` runs in it before its own script. With `bytesPerSecond` everything comes
  // that slowly. Any request for which `isAllowed(url)`
  // is false, and anything that the page complains about, is a failure.
  async visit(
    url,
    isAllowed,
    {
      width = 1280,
      height = 900,
      colorScheme = 'light',
      reducedMotion = 'reduce',
      before,
      bytesPerSecond,
    } = {},
  ) {
    const page = await this.context.newPage();
    if (before) await page.addInitScript(before);
    if (bytesPerSecond) {
      const session = await this.context.newCDPSession(page);
      await session.send('Network.emulateNetworkConditions', {
        offline: false,
        latency: 0,
        downloadThroughput: bytesPerSecond,
        uploadThroughput: -1,
      });
    }
    await page.setViewportSize({width, height});
    await page.emulateMedia({colorScheme, reducedMotion});
    const fail = text => this.failures.push(`${url}: ${text}`);
    page.on('console', message => {
      if (['error', 'warning'].includes(message.type()) && !isAboutReading(message.text()))
        fail(`console: ${message.text()}`);
    });
    page.on('pageerror', error => fail(`error: ${error.message}`));
    page.on('dialog', dialog => {
      fail(`dialog: ${dialog.message()}`);
      dialog.dismiss();
    });
    page.on('request', request => {
      if (!request.url().startsWith('data:') && !isAllowed(request.url()))
        fail(`request: ${request.url()}`);
    });
    await page.goto(url);
    return page;
  }

  // Opens a file, which may load nothing else.
  async open(file, options) {
    const url = pathToFileURL(resolve(file)).href;
    const page = await this.visit(url, address => address.split('#')[0] === url, options);
    await page.waitForFunction(
      () => document.querySelector('h1') || document.querySelector('.failure'),
    );
    await page.waitForTimeout(300); // charts are drawn when their places are known
    return page;
  }

  // Opens the page of a server on this machine, which may load from there alone. options: `at`,
  // what follows # in the address; `own`, where the address of the server is not that of the page
  openServer(url, {at = '', own: server = url, ...options} = {}) {
    const own = address => address.startsWith(server) || address.startsWith(`blob:${server}`);
    return this.visit(`${url}${at && `#${at}`}`, own, options);
  }

  // Runs each test as test(browser, ...args) and says which failed. `check` looks at what pages have
  // complained about; `before` and `after` are called around each test. ONLY=WORDS in the
  // environment: those tests alone whose names contain it. Closes the browser. Returns how many failed.
  async runTests(
    tests,
    {args = [], before, check = () => assert.deepEqual(this.failures, []), after} = {},
  ) {
    let failed = 0;
    for (const [name, test] of Object.entries(tests).filter(([name]) =>
      name.includes(process.env.ONLY ?? ''),
    )) {
      await before?.();
      try {
        await test(this, ...args);
        check();
        console.log(`ok      ${name}`);
      } catch (error) {
        ++failed;
        console.log(`FAILED  ${name}\n${error.stack}\n${this.failures.join('\n')}`);
      }
      this.failures.length = 0;
      await after?.();
    }
    await this.close();
    return failed;
  }

  async close() {
    await this.context.close();
    await rm(this.profile, {recursive: true, force: true});
  }
}

// The last line of a file of tests, and the end of its process.
export function finish(failed, note = '') {
  console.log(`${failed ? `${failed} failed` : 'all passed'}${note && `; ${note}`}`);
  process.exit(failed ? 1 : 0);
}
