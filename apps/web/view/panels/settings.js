// SPDX-License-Identifier: Apache-2.0
// The Settings panel.
import {el, segmented} from '../../shared/dom.js';
import {row, slider, toggleSwitch} from './parts.js';
import {GROUND_NAMES, POINT_SIZES, SPLAT_SCALES} from '../switches.js';

const named = name => [name, name[0].toUpperCase() + name.slice(1)];
const percent = x => `${Math.round(100 * x)}%`;

/// viewer: what the settings change. Returns {node, sync}; sync() brings the controls up to date
/// after a key or an address has changed a setting.
export function settings(viewer) {
  const {scene, stage, rig, controls, switches} = viewer;
  const isRemote = stage.isRemote,
    controlled = [];
  // A control of a switch follows it.
  const follow = (name, show) => controlled.push(() => show(switches.get(name)));
  const choice = (name, label, choices) => {
    const node = segmented(label, choices, String(switches.get(name)), value =>
      switches.set(name, typeof switches.get(name) === 'number' ? Number(value) : value),
    );
    follow(name, value => node.press(String(value)));
    return node;
  };
  const range = (name, label, limits, step, text) => {
    const made = slider(label, {...limits, step, value: switches.get(name)}, text, value =>
      switches.set(name, value),
    );
    follow(name, made.set);
    return made.node;
  };
  const frusta = toggleSwitch('frusta of the cameras', switches.get('frusta'), on =>
    switches.set('frusta', on),
  );
  follow('frusta', frusta.set);
  const speed = slider(
    'speed of flight',
    {min: -2, max: 2, step: 0.1, value: 0},
    x => `×${(2 ** x).toPrecision(2)}`,
    x => {
      controls.speed = 2 ** x;
    },
  );
  const field = slider(
    'field of view',
    {min: 20, max: 110, step: 1, value: 60},
    x => `${x}°`,
    degrees => viewer.widen(degrees),
  );
  controlled.push(() => field.set(Math.round(viewer.fieldOfView())));
  const degree = scene.model?.sh_degree ?? 3;
  const button = (text, title, onclick) =>
    el('button.button', {type: 'button', title, onclick}, text);
  const node = el(
    'div.settings',
    {},
    [
      row(
        'Picture',
        choice('show', 'picture', [
          ['color', 'Color'],
          ['depth', 'Depth'],
          ['normal', 'Normals'],
        ]),
      ),
      viewer.hasMesh &&
        row(
          'Surface',
          choice('mesh', 'splats or mesh', [
            ['0', 'Splats'],
            ['0.5', 'Both'],
            ['1', 'Mesh'],
          ]),
        ),
      viewer.hasMesh &&
        row(
          'Split',
          range('mesh', 'part of the picture with the mesh', {min: 0, max: 1}, 0.01, percent),
        ),
      viewer.hasMesh &&
        row(
          'Mesh',
          choice('meshlook', 'look of the mesh', [
            ['color', 'Color'],
            ['shaded', 'Shaded'],
            ['wires', 'Wires'],
          ]),
        ),
      viewer.hasLooks &&
        row(
          'Colors',
          choice('colors', 'colors', [
            ['neutral', 'Neutral'],
            ['photo', 'As the photo'],
          ]),
        ),
      row('Navigation', choice('navigation', 'navigation', [named('orbit'), named('fly')])),
      row('Flying', speed.node),
      row('Field of view', field.node),
      scene.cameras.length > 0 &&
        stage.frusta &&
        row(
          'Frusta',
          el(
            'span.pair',
            {},
            el('span.key', {}, el('i.dot.train'), 'training', el('i.dot.test'), 'test'),
            frusta.button,
          ),
        ),
      !isRemote && row('Splat size', range('scale', 'size of splats', SPLAT_SCALES, 0.05, percent)),
      !isRemote &&
        row(
          'Points',
          range('points', 'size of points', POINT_SIZES, 1, size => (size ? `${size} px` : 'off')),
        ),
      !isRemote && row('Background', choice('background', 'background', GROUND_NAMES.map(named))),
      !isRemote &&
        degree > 0 &&
        row(
          'SH degree',
          choice(
            'sh',
            'degree of spherical harmonics',
            [...Array(degree + 1).keys()].map(d => [String(d), String(d)]),
          ),
        ),
      !isRemote &&
        row(
          'While moving',
          segmented(
            'resolution while the view moves',
            [
              ['auto', 'Fewer pixels'],
              ['full', 'All pixels'],
            ],
            'auto',
            which => stage.setFullSize(which === 'full'),
          ),
        ),
      el(
        'div.row.buttons',
        {},
        button('Reset view', 'R', () => viewer.reset()),
        button('Level', 'L', () => rig.level()),
        button('Flip up', 'U', () => viewer.flipUp()),
      ),
    ].filter(Boolean),
  );
  const sync = () => controlled.forEach(show => show());
  return {node, sync};
}
