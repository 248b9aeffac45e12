// SPDX-License-Identifier: Apache-2.0
// Bundles each page into one self-contained HTML file with its script and style.
//   node build.mjs MODULES OUT
// MODULES holds node_modules (made by npm ci). Writes OUT/report.html, OUT/studio.html and OUT/view.html. The report
// keeps a placeholder, which gemsplat replaces with the data (gs_app/report/report_page.cpp); the
// viewer asks its server for data (docs/reference/viewer_http.md).
import {mkdir, readFile, writeFile} from 'node:fs/promises';
import {createRequire} from 'node:module';
import {dirname, join, resolve} from 'node:path';
import {fileURLToPath} from 'node:url';
import {sparkFix} from './spark_fix.mjs';

// The packages bundled into each page, whose licenses the page carries. Spark's build contains
// fflate.
const PAGES = {
  report: ['uplot'],
  studio: [],
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
    legalComments: 'none', // PAGES brings the full licenses
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
