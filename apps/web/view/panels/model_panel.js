// SPDX-License-Identifier: Apache-2.0
// The facts of the Model panel: the file, its Gaussians, and how fast they are drawn.
import {bytes, fixed, isNumber, whole} from '../../shared/format.js';
import {factList} from './parts.js';

const FRAMES_EVERY = 250; // milliseconds between updates of the speed

/// {node, show(), frame()}: show() after the model has changed, frame() after each frame.
export function modelFacts({scene, stage}) {
  const list = factList([
    'File',
    'Format',
    'Gaussians',
    'Shown',
    'SH degree',
    'Size',
    'Antialiased',
    'Cameras',
    'Frames',
    'Drawn by',
    'Latency',
    'On the server',
  ]);
  const show = () => {
    const {model} = scene;
    list.set('File', model?.name);
    list.set('Format', model?.format);
    list.set(
      scene.mode === 'live' ? 'Shown' : 'Gaussians',
      model && whole(stage.splats?.gaussians || model.gaussians),
    );
    list.set('SH degree', model?.sh_degree);
    list.set('Size', isNumber(model?.bytes) ? bytes(model.bytes) : null);
    list.set('Antialiased', model?.antialiased ? 'yes' : null);
    list.set('Drawn by', scene.device);
    const tests = scene.cameras.filter(camera => camera.split === 'test').length;
    list.set(
      'Cameras',
      scene.cameras.length
        ? whole(scene.cameras.length) + (tests ? `, ${whole(tests)} of them test` : '')
        : null,
    );
  };
  let last = 0;
  const frame = () => {
    const now = performance.now();
    if (now - last < FRAMES_EVERY) return;
    last = now;
    if (stage.frameTime && !stage.isRemote)
      list.set(
        'Frames',
        `${fixed(1000 / stage.frameTime, stage.frameTime > 100 ? 1 : 0)} per second`,
      );
    if (isNumber(stage.frames?.latency)) list.set('Latency', `${whole(stage.frames.latency)} ms`);
    if (isNumber(stage.frames?.render))
      list.set('On the server', `${fixed(stage.frames.render, 1)} ms`);
  };
  show();
  return {node: list.node, show, frame};
}
