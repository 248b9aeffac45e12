// SPDX-License-Identifier: Apache-2.0
// A scene of a few round Gaussians whose places in a picture are known, with cameras, photos and
// frames, made for tests.
import {deflateSync} from 'node:zlib';

const SH0 = 0.28209479177387814; // kSh0 of gs_core/math/constants.h

export const BLOBS = [
  {at: [0, 0, 0], color: [0.9, 0.9, 0.9]},
  {at: [1, 0, 0], color: [0.9, 0.1, 0.1]}, // to the right
  {at: [0, 0.8, 0], color: [0.1, 0.8, 0.1]}, // down
  {at: [-1, 0, 0.5], color: [0.1, 0.2, 0.9]},
];

/// The bytes of a PLY of SH degree 0 with these blobs, each of this standard deviation in world
/// units.
export function plyOf(blobs, deviation = 0.12) {
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
  const header = `ply\nformat binary_little_endian 1.0\nelement vertex ${blobs.length}\n${names.map(name => `property float ${name}\n`).join('')}end_header\n`;
  const scale = Math.log(deviation);
  const rows = blobs.map(({at, color}) => [
    ...at,
    ...color.map(c => (c - 0.5) / SH0),
    6,
    scale,
    scale,
    scale,
    1,
    0,
    0,
    0,
  ]);
  return Buffer.concat([Buffer.from(header), Buffer.from(Float32Array.from(rows.flat()).buffer)]);
}

const camera = (name, split, [x, y, z], lens = {}) => ({
  name,
  split,
  width: 400,
  height: 300,
  fx: 300,
  fy: 300,
  cx: 200,
  cy: 150,
  ...lens,
  world_from_camera: [1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z, 0, 0, 0, 1],
  photo: null,
});

export const CAMERAS = [
  camera('front.png', 'train', [0, 0, -4]),
  camera('aside/off center.png', 'test', [0.4, -0.2, -3], {
    width: 300,
    height: 360,
    fx: 280,
    fy: 290,
    cx: 90,
    cy: 200,
  }),
  camera('near.png', 'train', [-0.3, 0.15, -2.4]),
  camera('<b>odd</b>.png', 'test', [0.6, 0.5, -2.6]),
];

/// Where a camera's picture shows a point of the world, in pixels.
export function seenAt({world_from_camera: m, fx, fy, cx, cy}, [x, y, z]) {
  const depth = z - m[11];
  return [(fx * (x - m[3])) / depth + cx, (fy * (y - m[7])) / depth + cy];
}

export const sceneFor = (mode, more = {}) => ({
  title: 'a scene',
  mode,
  background: [0, 0, 0],
  up: [0, -1, 0],
  center: [0, 0, 0],
  radius: 2,
  near: 0.2,
  far: 1e4,
  cameras: CAMERAS,
  model: {
    format: 'ply',
    gaussians: BLOBS.length,
    bytes: plyOf(BLOBS).length,
    sh_degree: 0,
    antialiased: false,
    name: 'blobs.ply',
  },
  ...more,
});

function crc32(bytes) {
  let crc = ~0;
  for (const byte of bytes) {
    crc ^= byte;
    for (let bit = 0; bit < 8; ++bit) crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1;
  }
  return ~crc >>> 0;
}

/// A PNG of one color, each channel 0 to 255.
export function plainPng(width, height, color) {
  const chunk = (type, data) => {
    const body = Buffer.concat([Buffer.from(type), data]),
      frame = Buffer.alloc(8);
    frame.writeUInt32BE(data.length, 0);
    frame.writeUInt32BE(crc32(body), 4);
    return Buffer.concat([frame.subarray(0, 4), body, frame.subarray(4)]);
  };
  const head = Buffer.from([0, 0, 0, 0, 0, 0, 0, 0, 8, 2, 0, 0, 0]);
  head.writeUInt32BE(width, 0);
  head.writeUInt32BE(height, 4);
  const row = Buffer.concat([Buffer.from([0]), Buffer.alloc(3 * width, Buffer.from(color))]);
  return Buffer.concat([
    Buffer.from('89504e470d0a1a0a', 'hex'),
    chunk('IHDR', head),
    chunk('IDAT', deflateSync(Buffer.concat(Array(height).fill(row)))),
    chunk('IEND', Buffer.alloc(0)),
  ]);
}
