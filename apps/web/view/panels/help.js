// SPDX-License-Identifier: Apache-2.0
// The dialog that lists what the mouse, fingers and keys do.
import {el} from '../../shared/dom.js';
import {iconButton} from './parts.js';

const MOUSE = ['Mouse', [
  ['drag', 'orbit; in fly mode, look around'], ['right button, drag', 'look around'], ['Shift or middle button, drag', 'pan'],
  ['wheel', 'nearer, farther'], ['double click', 'orbit around this point'], ['click a camera', 'fly to it'],
]];
const FINGERS = ['Fingers', [
  ['one finger', 'orbit; in fly mode, look around'], ['two fingers', 'pan'], ['spread or pinch', 'nearer, farther'],
  ['twist', 'roll'], ['double tap', 'orbit around this point'], ['tap a camera', 'fly to it'],
]];
const KEYS = [
  ['Keys that move the view', [
    ['W A S D', 'fly ahead, left, back, right'], ['E Q', 'fly up, down'], ['Shift with these', 'four times as fast'],
    ['Alt + arrows', 'turn'], ['O', 'orbit or fly'], ['L', 'level the horizon'], ['U', 'swap up and down'], ['R', 'back to the first view'],
  ]],
  ['Cameras and photos', [
    ['← →', 'previous, next camera'], ['N', 'nearest camera'], ['F', 'show or hide the cameras'],
    ['C', 'render, slider, blend, photo'], ['X, held; Space, held', 'show the photo (Space: where nothing moves)'], ['M', 'PSNR of the render against the photo'],
  ]],
  ['Picture and tools', [
    ['1 2 3', 'color, depth, normals'], ['4', 'colors: neutral, or as the photo'], ['5', 'splats or points'], ['K', 'save a screenshot'], ['T', 'tools: picture, measure, crop, path'],
    ['V', 'add this view to the path'], ['Back, Forward', 'the places that were jumped to'],
  ]],
  ['Time, where the scene moves', [
    ['Space', 'play, pause'], [', .', 'a hundredth back, ahead'], ['Home End', 'begin, end'], ['[ ]', 'slower, faster'], ['J', 'loop'],
  ]],
  ['Page', [
    ['I', 'model panel'], ['G', 'list of cameras'], ['P', 'settings'], ['H', 'hide everything but the picture'], ['?', 'this help'], ['Esc', 'close'],
  ]],
];

const TOUCH = '(pointer: coarse), (max-width: 719px)';  // a phone or tablet

const forVisitors = ([title, entries]) => [title, entries.filter(([, effect]) => effect !== 'fly to it')];

/// Visitors of an exported page have no cameras, panels and tools to know about.
export function helpDialog({visitors, moves}) {
  const keys = visitors ? KEYS.filter(([title]) => title === 'Keys that move the view' || moves && title.startsWith('Time')) : KEYS;
  const [mouse, fingers] = visitors ? [MOUSE, FINGERS].map(forVisitors) : [MOUSE, FINGERS];
  const groups = matchMedia(TOUCH).matches ? [fingers, mouse, ...keys] : [mouse, ...keys, fingers];
  const dialog = el('dialog.help', {'aria-label': 'mouse, fingers and keys'},
    el('div.panel-head', {}, el('h2', {}, 'Mouse, fingers and keys'), iconButton('close', 'close', () => dialog.close())),
    el('div.help-columns', {}, groups.map(([title, entries]) => el('section', {}, el('h3', {}, title),
        el('dl', {}, entries.map(([input, effect]) => el('div', {}, el('dt', {}, input), el('dd', {}, effect))))))));
  dialog.addEventListener('click', event => { if (event.target === dialog) dialog.close(); });
  return dialog;
}
