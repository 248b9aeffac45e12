// SPDX-License-Identifier: Apache-2.0
// A model whose picture tells whether a program has read places, colors, SH and handedness right, from
// whatever side it is seen along z: four colors around the origin, one that is nearer on one side, and
// a gray one in the middle whose red depends on the direction (SH of degree 1).
import {writeFileSync} from 'node:fs';

const OPACITY = 0.95, C0 = 0.28209479177387814, C1 = 0.4886025119029199, SIGMA = 0.12;
const FAR = 5, FIELD = Math.PI / 3;  // units and radians: the cameras of pages.mjs

export const GAUSSIANS = {
  red: {at: [1, 0, 0], color: [0.9, 0.1, 0.1]}, green: {at: [0, 1, 0], color: [0.1, 0.8, 0.1]},
  blue: {at: [0, -1, 0], color: [0.2, 0.2, 0.9]}, white: {at: [-1, 0, 0], color: [0.9, 0.9, 0.9]},
  yellow: {at: [0.6, 0.6, -2], color: [0.9, 0.9, 0.1]}, gray: {at: [0, 0, 0], color: [0.3, 0.3, 0.3], redAlongZ: 0.3},
  // Black ones that are nearest and farthest: a program that leaves out one of these loses no color.
  front: {at: [-1.5, -1.5, 3], color: [0, 0, 0]}, back: {at: [-1.5, -1.5, -3], color: [0, 0, 0]},
};

const names = ['x', 'y', 'z', 'f_dc_0', 'f_dc_1', 'f_dc_2', ...Array.from({length: 9}, (_, i) => `f_rest_${i}`), 'opacity',
               'scale_0', 'scale_1', 'scale_2', 'rot_0', 'rot_1', 'rot_2', 'rot_3'];

export function writeCross(path) {
  const rows = Object.values(GAUSSIANS).map(({at, color, redAlongZ = 0}) => [
    ...at, ...color.map(c => (c - 0.5) / C0), 0, redAlongZ / C1, 0, 0, 0, 0, 0, 0, 0, Math.log(OPACITY / (1 - OPACITY)),
    ...[1, 1, 1].map(() => Math.log(SIGMA)), 1, 0, 0, 0]);
  const header = `ply\nformat binary_little_endian 1.0\nelement vertex ${rows.length}\n` +
      names.map(name => `property float ${name}\n`).join('') + 'end_header\n';
  writeFileSync(path, Buffer.concat([Buffer.from(header), Buffer.from(Float32Array.from(rows.flat()).buffer)]));
}

const distance = (a, b) => Math.hypot(...a.map((x, i) => x - b[i]));

// The brightest place of a color: the pixel that is nearest to what its peak should be.
function peakOf({data, size}, color) {
  const wanted = color.map(c => 255 * OPACITY * c);
  let best = {off: Infinity};
  for (let y = 0; y < size; ++y)
    for (let x = 0; x < size; ++x) {
      const seen = [...data.subarray(4 * (y * size + x), 4 * (y * size + x) + 3)], off = distance(seen, wanted);
      if (off < best.off) best = {off, seen, wanted, at: [x + 0.5 - size / 2, y + 0.5 - size / 2]};
    }
  return best;
}

const MOST_OFF = 30, MOST_PIXELS = 4;  // of a color and of a place: splats are drawn with small differences

/// What a picture says: {verdict, detail}. verdict: "right", "right, without SH", "wrong" or "nothing".
export function judge(picture) {
  const {data, size} = picture, focal = size / 2 / Math.tan(FIELD / 2), arm = focal / FAR;
  if (!data.some((value, i) => i % 4 < 3 && value > 20)) return {verdict: 'nothing', detail: 'the picture is black'};
  const peaks = Object.fromEntries(['red', 'green', 'blue', 'white', 'yellow'].map(name => [name, peakOf(picture, GAUSSIANS[name].color)]));
  const off = Object.entries(peaks).filter(([, {off}]) => off > MOST_OFF);
  if (off.length) {
    const [name, {seen, wanted}] = off[0];
    return {verdict: 'wrong', detail: `${name} is ${seen} and not ${wanted.map(Math.round)}`};
  }
  const {red, green, blue, white, yellow} = Object.fromEntries(Object.entries(peaks).map(([name, {at}]) => [name, at]));
  for (const [name, at] of Object.entries({red, green, blue, white}))
    if (Math.abs(Math.hypot(...at) - arm) > MOST_PIXELS) return {verdict: 'wrong', detail: `${name} is ${Math.round(Math.hypot(...at))} pixels from the middle, not ${Math.round(arm)}`};
  if (distance(red, white.map(x => -x)) > MOST_PIXELS || distance(green, blue.map(x => -x)) > MOST_PIXELS) return {verdict: 'wrong', detail: 'the colors do not face each other'};
  const radius = Math.hypot(...yellow), near = Math.hypot(0.6, 0.6) * focal / (FAR - 2), far = Math.hypot(0.6, 0.6) * focal / (FAR + 2);
  if (Math.min(Math.abs(radius - near), Math.abs(radius - far)) > MOST_PIXELS) return {verdict: 'wrong', detail: 'the yellow one is at another depth'};
  const isFront = Math.abs(radius - near) < Math.abs(radius - far);
  if ((red[0] * green[1] - red[1] * green[0] > 0) !== isFront) return {verdict: 'wrong', detail: 'it is mirrored'};
  const middle = data[4 * (Math.floor(size / 2) * size + Math.floor(size / 2))], peak = c => 255 * OPACITY * c;
  const expected = peak(isFront ? 0.6 : 0);
  if (Math.abs(middle - expected) < MOST_OFF) return {verdict: 'right', detail: ''};
  if (Math.abs(middle - peak(0.3)) < MOST_OFF) return {verdict: 'right, without SH', detail: ''};
  return {verdict: 'wrong', detail: `the red of SH is ${middle} and not ${Math.round(expected)}`};
}
