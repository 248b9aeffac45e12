// SPDX-License-Identifier: Apache-2.0
// The page of `gemsplat export model.html`, opened from a disk: it shows what `gemsplat render` shows
// of the model inside, and asks for nothing but itself.
//   node model_page_test.mjs MODULES PROGRAM SCENE OUT CHROMIUM
import {execFileSync} from 'node:child_process';
import {readFile, rm, writeFile} from 'node:fs/promises';
import {join, resolve} from 'node:path';
import {pathToFileURL} from 'node:url';
import {Browser, findChromium} from './browser.mjs';
import {psnr} from './pictures.mjs';

const [modules, program, scene, out] = process.argv.slice(2, 6).map(path => resolve(path)),
  chromium = findChromium(process.argv[6]);
const LEAST = 45; // dB, as in view_agreement.mjs
const gemsplat = (...words) =>
  execFileSync(program, [...words, '-q'], {stdio: ['ignore', 'ignore', 'inherit']});

await rm(out, {recursive: true, force: true});
const run = join(out, 'run'),
  file = join(out, 'model.html');
gemsplat(
  'train',
  scene,
  '-o',
  run,
  '--device',
  'cpu',
  '-r',
  '4',
  '-i',
  '100',
  '--eval',
  '--set',
  'density.max_gaussians=5000',
);
gemsplat('export', run, file, join(out, 'model.sog'), '--no-measure');
gemsplat(
  'render',
  join(out, 'model.sog'),
  '--cameras',
  join(run, 'cameras.json'),
  '-c',
  run,
  '-r',
  '1',
  '-o',
  join(out, 'render'),
  '--device',
  'cpu',
);
const [camera] = JSON.parse(await readFile(join(run, 'cameras.json'), 'utf8'));

const browser = await Browser.start(modules, chromium, {server: true});
browser.context.setDefaultTimeout(300_000);
const url = pathToFileURL(file).href,
  isOwn = address => address.split('#')[0] === url || address.startsWith('blob:null/'); // its workers
const page = await browser.visit(`${url}#c=0&ui=0`, isOwn, {
  width: camera.width,
  height: camera.height,
});
await page.waitForFunction(() =>
  gemsplatViewer.ready.then(() => gemsplatViewer.settled()).then(() => true),
);
const picture = await page.screenshot();
await writeFile(join(out, 'page.png'), picture);
const dB = await psnr(
  page,
  picture,
  await readFile(join(out, 'render', `${camera.img_name.replace(/\.[^.]*$/, '')}.png`)),
);
const {gaussians, mode} = await page.evaluate('gemsplatViewer.state()');
await browser.close();

console.log(`the page of ${gaussians} Gaussians against gemsplat render: ${dB.toFixed(2)} dB`);
for (const failure of browser.failures) console.log(failure);
const passed = dB >= LEAST && mode === 'file' && gaussians > 100 && browser.failures.length === 0;
console.log(passed ? 'ok' : 'FAILED');
process.exit(passed ? 0 : 1);
