// SPDX-License-Identifier: Apache-2.0
// Plays a model that moves and writes what was on the screen as a contact sheet, sheet.png: each
// column is a moment, also at the ends of time. Above is a frame that was shown while the model played,
// in the middle the still picture of the same time, below four times their difference. A frame
// between two times, a ghost or a flicker is a bright spot there. Also prints the PSNR of the pairs.
//   node view_contact_sheet.mjs MODULES PROGRAM MODEL OUT CHROMIUM [--cameras FILE]
import {mkdir, writeFile} from 'node:fs/promises';
import {join, resolve} from 'node:path';
import {Browser} from './browser.mjs';
import {serveProgram} from './serve_program.mjs';

const [modules, program, model, out, chromium, ...words] = process.argv.slice(2);
const WIDTH = 320,
  HEIGHT = 240,
  COLUMNS = 10;
const SPEED = 0.25; // software WebGL draws a few frames a second
const LEAST_DB = 40; // of a frame against the still picture of its time: no other time is in it

// Runs in the page: keeps each frame that is shown, with the time that it is sorted for.
function record() {
  const {stage} = app.viewer,
    {splats} = stage,
    drawn = stage.drawn;
  window.shown = new Map();
  stage.setFullSize(true);
  stage.drawn = view => {
    drawn(view);
    const time = splats.timeOf.get(splats.spark.display);
    if (window.isRecording && time !== undefined) window.shown.set(time, window.copied());
  };
  window.copied = () => {
    const canvas = new OffscreenCanvas(stage.canvas.width, stage.canvas.height);
    canvas.getContext('2d').drawImage(stage.canvas, 0, 0);
    return canvas;
  };
}

// Runs in the page: plays over the end of time until the begin has come again.
async function play(speed) {
  const {player} = app.viewer,
    pause = milliseconds => new Promise(done => setTimeout(done, milliseconds));
  player.seek(0);
  await gemsplatViewer.settled();
  player.speed = speed;
  window.isRecording = true;
  player.play(true);
  let last = 0,
    turns = 0;
  while (turns < 1 || player.time < 0.15) {
    await pause(20);
    if (player.time < last) ++turns;
    last = player.time;
  }
  player.play(false);
  window.isRecording = false;
  return [...window.shown.keys()].sort((a, b) => a - b);
}

// Runs in the page: the pairs of these times, and the sheet as a data URL.
async function compare(times) {
  const {canvas} = app.viewer.stage,
    {width, height} = canvas;
  const sheet = new OffscreenCanvas((times.length * width) / 2, (3 * height) / 2),
    context = sheet.getContext('2d'),
    found = [];
  const pixels = each => each.getContext('2d').getImageData(0, 0, width, height);
  for (const [column, time] of times.entries()) {
    await gemsplatViewer.setTime(time);
    await gemsplatViewer.settled();
    const still = await new Promise(done => {
      // in the frame in which it is drawn, while the canvas has it
      const {stage} = app.viewer,
        drawn = stage.drawn;
      stage.drawn = view => {
        drawn(view);
        stage.drawn = drawn;
        done(window.copied());
      };
      stage.request();
    });
    const played = window.shown.get(time),
      a = pixels(played),
      b = pixels(still),
      difference = new ImageData(width, height);
    let sum = 0;
    for (let i = 0; i < a.data.length; ++i) {
      const by = a.data[i] - b.data[i];
      difference.data[i] = i % 4 === 3 ? 255 : Math.min(255, 4 * Math.abs(by));
      sum += by * by;
    }
    found.push({
      time,
      dB: Math.min(100, -10 * Math.log10(Math.max(sum / (3 * width * height) / 255 ** 2, 1e-10))),
    });
    const below = new OffscreenCanvas(width, height);
    below.getContext('2d').putImageData(difference, 0, 0);
    [played, still, below].forEach((each, row) =>
      context.drawImage(each, (column * width) / 2, (row * height) / 2, width / 2, height / 2),
    );
    context.fillStyle = '#fff';
    context.fillText(time.toFixed(3), (column * width) / 2 + 6, 14);
  }
  const blob = await sheet.convertToBlob({type: 'image/png'}),
    bytes = new Uint8Array(await blob.arrayBuffer());
  return {found, png: btoa([...bytes].map(byte => String.fromCharCode(byte)).join(''))};
}

await mkdir(out, {recursive: true});
const server = await serveProgram(
  program,
  'view',
  resolve(model),
  ...words,
  '--no-open',
  '--port',
  '0',
);
const browser = await Browser.start(modules, chromium, {server: true});
const page = await browser.openServer(server.url, {
  at: 'c=0&ui=0&t=0',
  width: WIDTH,
  height: HEIGHT,
});
page.setDefaultTimeout(300_000);
await page.waitForFunction(() =>
  gemsplatViewer.ready.then(() => gemsplatViewer.settled()).then(() => true),
);
await page.evaluate(record);
const shown = await page.evaluate(play, SPEED);
// The first and the last frame, and others between them.
const chosen = [
  ...new Set(
    Array.from(
      {length: COLUMNS},
      (_, i) => shown[Math.round((i * (shown.length - 1)) / (COLUMNS - 1))],
    ),
  ),
];
const {found, png} = await page.evaluate(compare, chosen);
await writeFile(join(out, 'sheet.png'), Buffer.from(png, 'base64'));
for (const {time, dB} of found) console.log(`time ${time.toFixed(4)}: ${dB.toFixed(1)} dB`);
console.log(`${shown.length} frames were shown; ${join(out, 'sheet.png')}`);
await browser.close();
await server.end();
const worst = Math.min(...found.map(({dB}) => dB));
if (worst < LEAST_DB || browser.failures.length) {
  console.log(`FAILED  the worst frame has ${worst.toFixed(1)} dB; ${browser.failures.join('\n')}`);
  process.exit(1);
}
process.exit(0);
