// SPDX-License-Identifier: Apache-2.0
// Makes each page one self-contained HTML file: script and style bundled into it, nothing left to load.
//   node build.mjs MODULES OUT
// MODULES holds node_modules (npm ci puts it there); OUT/report.html and OUT/view.html are written. The place of the
// report's data stays open: gemsplat puts it in (gs_app/report/report_page.cpp). The viewer asks its server (docs/viewer.md).
import {mkdir, readFile, writeFile} from 'node:fs/promises';
import {createRequire} from 'node:module';
import {dirname, join, resolve} from 'node:path';
import {fileURLToPath} from 'node:url';
import {sparkFix} from './spark_fix.mjs';

// What is bundled into each page, and whose licenses therefore go into it. Spark's build holds fflate.
const PAGES = {
  report: ['uplot'],
  view: ['@sparkjsdev/spark', 'fflate', 'three', 'uplot'],
};

const here = dirname(fileURLToPath(import.meta.url));
const [modules, out] = process.argv.slice(2).map(path => resolve(path));
const esbuild = createRequire(join(modules, 'package.json'))('esbuild');

async function bundle(file) {
  const result = await esbuild.build({
    entryPoints: [join(here, file)],
    nodePaths: [join(modules, 'node_modules')],
    bundle: true,
    minify: true,
    write: false,
    format: 'iife',
    target: ['es2020'],
    charset: 'utf8',
    legalComments: 'none',  // the licenses are below, whole
    logLevel: 'warning',
    plugins: [sparkFix],
  });
  return result.outputFiles[0].text.trim();
}

async function licenses(names) {
  const texts = [];
  for (const name of names) {
    const folder = join(modules, 'node_modules', name);
    const {version} = JSON.parse(await readFile(join(folder, 'package.json'), 'utf8'));
    const text = (await readFile(join(folder, 'LICENSE'), 'utf8')).trim();
    if (text.includes('--')) throw new Error(`the license of ${name} cannot stand in a comment`);
    texts.push(`This page contains ${name} ${version}:\n\n${text}`);
  }
  return texts.join('\n\n');
}

await mkdir(out, {recursive: true});
for (const [page, bundled] of Object.entries(PAGES)) {
  const parts = {
    LICENSES: await licenses(bundled),
    STYLE: await bundle(`${page}/page.css`),
    SCRIPT: await bundle(`${page}/main.js`),
  };
  const template = await readFile(join(here, page, 'page.html'), 'utf8');
  const html = template.replace(/@(LICENSES|STYLE|SCRIPT)@/g, (_, name) => parts[name]);
  await writeFile(join(out, `${page}.html`), html);
}
