// SPDX-License-Identifier: Apache-2.0
// Which keys and gestures there are.
import {el} from '../shared/dom.js';
import {iconButton} from './parts.js';

const GROUPS = [
  ['Moving', [
    ['drag', 'orbit; in fly mode look around'], ['right button, drag', 'look around'], ['Shift or middle button, drag', 'shift'],
    ['wheel, or two fingers apart', 'nearer, farther'], ['double click', 'orbit around this point'],
    ['W A S D', 'fly ahead, left, back, right'], ['E Q', 'fly up, down'], ['Shift with these', 'four times as fast'],
    ['Alt + arrows', 'turn'], ['O', 'orbit or fly'], ['L', 'level the horizon'], ['U', 'turn up and down around'], ['R', 'to the first view'],
  ]],
  ['Cameras and photos', [
    ['click a frustum', 'to this camera'], ['← →', 'previous, next camera'], ['N', 'to the nearest camera'], ['F', 'frusta on or off'],
    ['C', 'render, slider, blend, photo'], ['Space, held', 'the photo'], ['1 2 3', 'color, depth, normals, of frames from the server'],
  ]],
  ['Page', [
    ['G', 'list of cameras'], ['P', 'settings'], ['I', 'figures'], ['H', 'hide everything but the picture'], ['?', 'this list'], ['Esc', 'close'],
  ]],
];

export function helpDialog() {
  const dialog = el('dialog.help', {'aria-label': 'keys and gestures'},
    el('div.panel-head', {}, el('h2', {}, 'Keys and gestures'), iconButton('close', 'close', () => dialog.close())),
    el('div.help-columns', {}, GROUPS.map(([title, keys]) => el('section', {}, el('h3', {}, title),
        el('dl', {}, keys.map(([key, what]) => el('div', {}, el('dt', {}, key), el('dd', {}, what))))))));
  dialog.addEventListener('click', event => { if (event.target === dialog) dialog.close(); });
  return dialog;
}
