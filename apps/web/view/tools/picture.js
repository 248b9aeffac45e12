// SPDX-License-Identifier: Apache-2.0
// The picture without anything over it, at any number of pixels: for screenshots and for PSNR.
import {NearestFilter, UnsignedByteType, WebGLRenderTarget} from 'three';
import {fitted, projectionOf, resized} from '../picture/lens.js';
import {askForPhoto} from '../server.js';

const MOST_REMOTE = 4096; // pixels on a side: the server's limit

/// The lens's picture of the stage's present view as ImageData of width x height. The view has to be
/// settled.
export function pixelsOf(stage, lens, width, height) {
  const {renderer, splats, scene} = stage;
  const target = new WebGLRenderTarget(width, height, {
    type: UnsignedByteType,
    minFilter: NearestFilter,
    magFilter: NearestFilter,
  });
  const bottomUp = new Uint8Array(4 * width * height),
    image = new ImageData(width, height);
  try {
    splats.place(stage.pose, projectionOf(lens, scene.near, scene.far));
    splats.draw(width, height, lens, target);
    stage.drawMesh(width, height, target);
    splats.surface.read(target, 0, 0, width, height, bottomUp);
  } finally {
    renderer.setRenderTarget(null);
    target.dispose();
    stage.request(); // the canvas shows its own view again
  }
  for (let y = 0; y < height; ++y)
    image.data.set(
      bottomUp.subarray(4 * width * (height - 1 - y), 4 * width * (height - y)),
      4 * width * y,
    );
  return image;
}

function canvasOf(image) {
  const canvas = new OffscreenCanvas(image.width, image.height);
  canvas.getContext('2d').putImageData(image, 0, 0);
  return canvas;
}

/// A PNG of what the window shows without interface, with `times` as many pixels on each side.
export async function screenshot(stage, times) {
  await stage.settled();
  const lens = stage.lens(),
    largest = stage.isRemote ? MOST_REMOTE : stage.renderer.capabilities.maxTextureSize;
  const ratio = Math.min(stage.pixelRatio * times, largest / Math.max(stage.width, stage.height));
  const [width, height] = [stage.width, stage.height].map(side => Math.round(side * ratio));
  if (!stage.isRemote)
    return canvasOf(pixelsOf(stage, lens, width, height)).convertToBlob({type: 'image/png'});
  const frame = await stage.frames.frameOf(
    {pose: stage.pose, time: stage.time, through: stage.through()},
    resized(lens, width, height),
  );
  const canvas = new OffscreenCanvas(width, height);
  canvas.getContext('2d').drawImage(frame, 0, 0);
  return canvas.convertToBlob({type: 'image/png'});
}

/// PSNR in dB of the camera's picture against its photo, over all pixels of 8 bits.
export async function psnrOf(stage, camera) {
  const photo = await askForPhoto(camera.photo);
  await stage.settled();
  const {width, height} = camera,
    quantity = stage.splats.quantity;
  stage.splats.quantity = 'color';
  const picture = pixelsOf(stage, fitted(camera, width, height), width, height).data;
  stage.splats.quantity = quantity;
  const canvas = new OffscreenCanvas(width, height),
    context = canvas.getContext('2d', {willReadFrequently: true});
  context.drawImage(photo, 0, 0, width, height);
  const wanted = context.getImageData(0, 0, width, height).data;
  let sum = 0;
  for (let i = 0; i < picture.length; ++i) if (i % 4 < 3) sum += (picture[i] - wanted[i]) ** 2;
  return Math.min(100, -10 * Math.log10(sum / (3 * width * height) / 255 ** 2));
}
