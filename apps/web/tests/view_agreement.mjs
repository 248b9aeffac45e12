// SPDX-License-Identifier: Apache-2.0
// How well the viewer's picture agrees with gemsplat's own, in dB, for each format that the viewer
// reads: the page at the exact size of a camera, its interface hidden, against `gemsplat render` of
// the same file. Fails below LEAST.
//   node view_agreement.mjs MODULES PROGRAM OUT CHROMIUM [RUN...] [--scene FOLDER] [--views 3] [--formats ply,spz] [--least 45]
// MODULES holds node_modules and view.html. --scene: also of two short runs on this scene, the
// second antialiased.
import {execFileSync} from 'node:child_process';
import {existsSync} from 'node:fs';
import {mkdir, readFile, readdir, rm, writeFile} from 'node:fs/promises';
import {basename, join, resolve} from 'node:path';
import {parseArgs} from 'node:util';
import {Browser, findChromium} from './browser.mjs';
import {psnr} from './pictures.mjs';
import {ViewServer, sceneOf} from './view_server.mjs';

const {values: options, positionals} = parseArgs({
  allowPositionals: true,
  options: {
    scene: {type: 'string'},
    views: {type: 'string', default: '3'},
    formats: {type: 'string', default: 'ply,compressed.ply,spz,sog'},
    least: {type: 'string', default: '45'},
  },
});
const [modules, program, out, named, ...runs] = positionals.map((path, i) =>
  i === 3 ? path : resolve(path),
);
const chromium = findChromium(named);
const gemsplat = (...words) =>
  execFileSync(program, words, {stdio: ['ignore', 'pipe', 'inherit']}).toString();

const SHORT = [
  '--device',
  'cpu',
  '-q',
  '-r',
  '4',
  '-i',
  '300',
  '--eval',
  '--set',
  'density.max_gaussians=5000',
];

async function shortRuns(scene) {
  await rm(out, {recursive: true, force: true});
  return ['false', 'true'].map(antialias => {
    const run = join(out, 'runs', antialias === 'true' ? 'antialiased' : 'classic');
    gemsplat(
      'train',
      resolve(scene),
      '-o',
      run,
      ...SHORT,
      '--set',
      `render.antialias=${antialias}`,
    );
    return run;
  });
}

async function measure(browser, run, format) {
  const name = basename(run),
    file = join(out, name, `${name}.${format}`),
    renders = join(out, name, `render-${format}`);
  if (!existsSync(file)) gemsplat('export', run, file, '--no-measure', '-q');
  const config = await readFile(join(run, 'config.toml'), 'utf8');
  const antialiased = /^antialias = true/m.test(config),
    [, degree] = config.match(/^sh_degree = (\d)/m);
  const scene = await sceneOf(run, file, {antialiased, shDegree: Number(degree)});
  if (!existsSync(renders))
    gemsplat(
      'render',
      file,
      '--cameras',
      join(run, 'cameras.json'),
      '-c',
      run,
      '-r',
      '1',
      '-o',
      renders,
      '-q',
      '--device',
      'cpu',
    );
  const rendered = new Set(await readdir(renders));
  const cameras = scene.cameras.map((camera, index) => ({...camera, index}));
  const some = Array.from(
    {length: Math.min(Number(options.views), cameras.length)},
    (_, i, count = Number(options.views)) => cameras[Math.floor((i * cameras.length) / count)],
  ).filter(camera => rendered.has(`${camera.name.replace(/\.[^.]*$/, '')}.png`));
  const server = await ViewServer.start({
    page: join(modules, 'view.html'),
    scene,
    model: () => readFile(file),
  });
  const results = [];
  for (const camera of some) {
    const page = await browser.openServer(server.url, {
      at: `c=${camera.index}&ui=0`,
      width: camera.width,
      height: camera.height,
    });
    await page.waitForFunction(() =>
      gemsplatViewer.ready.then(() => gemsplatViewer.settled()).then(() => true),
    );
    const picture = await page.screenshot();
    await writeFile(
      join(out, name, `page-${format}-${camera.name.replaceAll('/', '-')}.png`),
      picture,
    );
    results.push(
      await psnr(
        page,
        picture,
        await readFile(join(renders, `${camera.name.replace(/\.[^.]*$/, '')}.png`)),
      ),
    );
    await page.close();
  }
  await server.close();
  return results;
}

const browser = await Browser.start(modules, chromium, {server: true});
browser.context.setDefaultTimeout(300_000);
let worst = runs.length || options.scene ? Infinity : -Infinity;
for (const run of [...runs, ...(options.scene ? await shortRuns(options.scene) : [])]) {
  await mkdir(join(out, basename(run)), {recursive: true});
  console.log(`${basename(run)}\n| format | dB, each view | least |\n|---|---|---|`);
  for (const format of options.formats.split(',')) {
    const results = await measure(browser, run, format);
    const least = Math.min(...results);
    worst = Math.min(worst, least);
    console.log(
      `| ${format} | ${results.map(dB => dB.toFixed(2)).join(' ')} | ${least.toFixed(2)} |`,
    );
  }
}
await browser.close();
for (const failure of browser.failures) console.log(failure);
const passed = worst >= Number(options.least) && browser.failures.length === 0;
console.log(passed ? `all at least ${options.least} dB` : 'FAILED');
process.exit(passed ? 0 : 1);
