// SPDX-License-Identifier: Apache-2.0
// The dialog that lists what the mouse, fingers and keys do.
import {el} from '../../shared/dom.js';
import {shownGroups} from '../keys.js';
import {iconButton} from './parts.js';

const TOUCH = '(pointer: coarse), (max-width: 719px)'; // a phone or tablet

/// Visitors of an exported page have no cameras, panels and tools to know about.
export function helpDialog(scene) {
  const {mouse, fingers, keys} = shownGroups(scene);
  const groups = matchMedia(TOUCH).matches ? [fingers, mouse, ...keys] : [mouse, ...keys, fingers];
  const dialog = el(
    'dialog.help',
    {'aria-label': 'mouse, fingers and keys'},
    el(
      'div.panel-head',
      {},
      el('h2', {}, 'Mouse, fingers and keys'),
      iconButton('close', 'close', () => dialog.close()),
    ),
    el(
      'div.help-columns',
      {},
      groups.map(({title, rows}) =>
        el(
          'section',
          {},
          el('h3', {}, title),
          el(
            'dl',
            {},
            rows.map(([input, effect]) => el('div', {}, el('dt', {}, input), el('dd', {}, effect))),
          ),
        ),
      ),
    ),
  );
  dialog.addEventListener('click', event => {
    if (event.target === dialog) dialog.close();
  });
  return dialog;
}
