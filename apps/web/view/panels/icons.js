// SPDX-License-Identifier: Apache-2.0
// The icons of the viewer's buttons: paths in a square of 24 x 24.
import {svg} from '../../shared/dom.js';

const LINES = {
  cameras: 'M3 8.5h4l1.6-2.5h6.8L17 8.5h4v10.5H3z M12 10.2a3.4 3.4 0 1 0 .01 0',
  settings: 'M4 7h9 M17 7h3 M15 4.8v4.4 M4 12h3 M11 12h9 M9 9.8v4.4 M4 17h9 M17 17h3 M15 14.8v4.4',
  model: 'M4 20V4 M4 20h16 M8 16l4-5 3 3 5-7',
  tools:
    'M14.5 6.2a4 4 0 0 1 5.2-1.6l-2.6 2.7.3 1.9 1.9.3 2.5-2.6a4 4 0 0 1-5.4 5L9.2 19.2a2.1 2.1 0 0 1-3-3z',
  help: 'M9 9.2a3 3 0 1 1 4.4 2.7c-1 .6-1.4 1.1-1.4 2.3 M12 17.4v.2',
  full: 'M4 9V4h5 M15 4h5v5 M20 15v5h-5 M9 20H4v-5',
  reset: 'M4.5 12a7.5 7.5 0 1 0 2.4-5.5 M4.5 4v4.5H9',
  previous: 'M14.5 5.5 8 12l6.5 6.5',
  next: 'M9.5 5.5 16 12l-6.5 6.5',
  up: 'M6 14.5 12 8.5l6 6',
  play: 'M8 5.5v13l10.5-6.5z',
  pause: 'M8.5 5.5v13 M15.5 5.5v13',
  loop: 'M5 11V9.5A3.5 3.5 0 0 1 8.5 6H18 M15.5 3.2 18.3 6l-2.8 2.8 M19 13v1.5a3.5 3.5 0 0 1-3.5 3.5H6 M8.5 15.2 5.7 18l2.8 2.8',
  close: 'M6 6l12 12 M18 6 6 18',
};

export const icon = name =>
  svg(
    'svg',
    {viewBox: '0 0 24 24', class: 'icon', 'aria-hidden': 'true'},
    svg('path', {d: LINES[name]}),
  );
