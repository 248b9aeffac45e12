// SPDX-License-Identifier: Apache-2.0
// A model in `gemsplat view`, which streams it: the whole model is seen when a twentieth of its bytes
// has come, and the others are held back.
//   node view_stream_test.mjs MODULES PROGRAM OUT CHROMIUM
import assert from 'node:assert/strict';
import {mkdir, open} from 'node:fs/promises';
import {createServer, request as ask} from 'node:http';
import {join, resolve} from 'node:path';
import {Browser, findChromium} from './browser.mjs';
import {serveProgram} from './serve_program.mjs';

const [modules, program, out] = process.argv.slice(2, 5).map(path => resolve(path)),
  chromium = findChromium(process.argv[5]);

const COUNT = 300_000; // Gaussians
const MOST = 0.05; // of the bytes. The first chunk is 1/64 of the tree
const PIECE = 16_384; // bytes
const PATIENCE = 240_000; // milliseconds: software WebGL on a busy machine
const PLACES = [-1.4, 0, 1.4].flatMap(x => [-1.4, 0, 1.4].map(y => [x, y, 0])); // of the model

// A waved square of small Gaussians, whose places repeat in each run.
async function writeSheet(file) {
  const names = [
    'x',
    'y',
    'z',
    'f_dc_0',
    'f_dc_1',
    'f_dc_2',
    'opacity',
    'scale_0',
    'scale_1',
    'scale_2',
    'rot_0',
    'rot_1',
    'rot_2',
    'rot_3',
  ];
  let state = 12345;
  const draw = () => {
    state ^= state << 13;
    state ^= state >>> 17;
    state ^= state << 5;
    return (state >>> 0) / 2 ** 31 - 1;
  };
  const rows = new Float32Array(names.length * COUNT);
  for (let i = 0; i < COUNT; ++i) {
    const u = draw(),
      v = draw();
    rows.set(
      [
        2 * u,
        2 * v,
        0.2 * Math.sin(5 * u) * Math.cos(4 * v),
        1 + 0.5 * u,
        1 + 0.5 * v,
        1,
        3,
        -4.5,
        -4.5,
        -4.5,
        1,
        0,
        0,
        0,
      ],
      names.length * i,
    );
  }
  const handle = await open(file, 'w');
  await handle.write(
    `ply\nformat binary_little_endian 1.0\nelement vertex ${COUNT}\n${names.map(name => `property float ${name}\n`).join('')}end_header\n`,
  );
  await handle.write(Buffer.from(rows.buffer));
  await handle.close();
}

// Stands between page and program: lets `most` bytes of the model through, and holds the others back.
async function holdingBack(to, most) {
  const counted = {bytes: 0};
  const http = createServer((from, answer) =>
    ask(
      new URL(from.url, to),
      {headers: {...(from.headers.range ? {range: from.headers.range} : {})}},
      async got => {
        answer.writeHead(got.statusCode, got.headers);
        if (!from.url.startsWith('/model')) return got.pipe(answer);
        for await (const part of got)
          for (let at = 0; at < part.length; at += PIECE) {
            if (answer.destroyed) return;
            const piece = part.subarray(at, at + PIECE);
            if (counted.bytes + piece.length > most) return; // and the answer never ends
            counted.bytes += piece.length;
            answer.write(piece);
          }
        answer.end();
      },
    ).end(),
  );
  await new Promise(done => http.listen(0, '127.0.0.1', done));
  return {
    url: `http://127.0.0.1:${http.address().port}/`,
    counted,
    close: () => {
      http.closeAllConnections();
      http.close();
    },
  };
}

// Runs in the page: notes when all places of the model are lit.
function watch(places) {
  const {stage} = app.viewer,
    drawn = stage.drawn,
    gl = stage.renderer.getContext(),
    pixel = new Uint8Array(4);
  stage.drawn = view => {
    drawn(view);
    const {position: p, quaternion} = view.pose,
      back = quaternion.clone().invert(),
      {fx, fy, cx, cy} = view.lens,
      ratio = gl.drawingBufferWidth / stage.width;
    const bound = gl.getParameter(gl.PIXEL_PACK_BUFFER_BINDING);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    const isLit = places.every(([x, y, z]) => {
      const at = p.clone().set(x, y, z).sub(p).applyQuaternion(back);
      gl.readPixels(
        ratio * (cx - (fx * at.x) / at.z),
        gl.drawingBufferHeight - ratio * (cy + (fy * at.y) / at.z),
        1,
        1,
        gl.RGBA,
        gl.UNSIGNED_BYTE,
        pixel,
      );
      return Math.max(...pixel.subarray(0, 3)) > 60;
    });
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, bound);
    if (isLit) window.isSeen = true;
  };
}

await mkdir(out, {recursive: true});
const file = join(out, 'sheet.ply');
await writeSheet(file);
const server = await serveProgram(
  program,
  'view',
  file,
  '--no-open',
  '--port',
  '0',
  '--stream-from',
  String(COUNT),
);
const {model} = await (await fetch(`${server.url}scene.json`)).json();
assert.equal(model.format, 'rad', 'it streams');
const proxy = await holdingBack(server.url, MOST * model.bytes),
  browser = await Browser.start(modules, chromium, {server: true});
let failure = null;
try {
  const page = await browser.openServer(proxy.url, {width: 640, height: 480});
  await page.waitForFunction(() => globalThis.app?.viewer?.stage);
  await page.evaluate(watch, PLACES);
  await page.waitForFunction(() => window.isSeen, null, {timeout: PATIENCE});
  const share = proxy.counted.bytes / model.bytes;
  await page.screenshot({path: join(out, 'first-picture.png')});
  console.log(
    `        the whole model is seen after ${(100 * share).toFixed(1)} % of ${model.bytes} bytes`,
  );
  assert.ok(share > 0 && share <= MOST, String(share));
  assert.deepEqual(browser.failures, []);
  console.log('ok      the whole of a streamed model is seen when a twentieth of it has come');
} catch (error) {
  failure = error;
  console.log(`FAILED  ${error.stack}\n${browser.failures.join('\n')}`);
}
await browser.close();
proxy.close();
await server.end();
process.exit(failure ? 1 : 0);
