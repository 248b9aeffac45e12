// SPDX-License-Identifier: Apache-2.0
// What mouse, fingers and keys do, as one table: panels/help.js prints it, and this file binds its
// keys.

const fail = viewer => error => viewer.messages.fail(error);
const toggled = (switches, name, off, on) =>
  switches.set(name, switches.get(name) === on ? off : on);

async function measurePsnr(viewer) {
  viewer.panels.tools.toggle(true);
  viewer.toolPanel.open('Picture');
  await viewer.tools.picture.measure();
}

const FOR_CAMERAS = 'cameras'; // pages for visitors have none

/// Groups of rows: what people see of the input, its effect, and what keys call with the viewer.
/// Rows without keys are those of controls.js and of the browser. `visitors`: pages for visitors have
/// it, too; `moves`: only where the scene moves.
export const MOUSE = {
  title: 'Mouse',
  rows: [
    ['drag', 'orbit; in fly mode, look around'],
    ['right button, drag', 'look around'],
    ['Shift or middle button, drag', 'pan'],
    ['wheel', 'nearer, farther'],
    ['double click', 'orbit around this point'],
    ['click a camera', 'fly to it', FOR_CAMERAS],
  ],
};
export const FINGERS = {
  title: 'Fingers',
  rows: [
    ['one finger', 'orbit; in fly mode, look around'],
    ['two fingers', 'pan'],
    ['spread or pinch', 'nearer, farther'],
    ['twist', 'roll'],
    ['double tap', 'orbit around this point'],
    ['tap a camera', 'fly to it', FOR_CAMERAS],
  ],
};
export const KEYS = [
  {
    title: 'Keys that move the view',
    visitors: true,
    rows: [
      ['W A S D', 'fly ahead, left, back, right'],
      ['E Q', 'fly up, down'],
      ['Shift with these', 'four times as fast'],
      ['Alt + arrows', 'turn'],
      ['O', 'orbit or fly', {o: ({switches}) => toggled(switches, 'navigation', 'orbit', 'fly')}],
      ['L', 'level the horizon', {l: ({rig}) => rig.level()}],
      ['U', 'swap up and down', {u: viewer => viewer.flipUp()}],
      ['R', 'back to the first view', {r: viewer => viewer.reset()}],
    ],
  },
  {
    title: 'Cameras and photos',
    rows: [
      [
        '← →',
        'previous, next camera',
        {ArrowLeft: viewer => viewer.stepCamera(-1), ArrowRight: viewer => viewer.stepCamera(1)},
      ],
      ['N', 'nearest camera', {n: viewer => viewer.goToNearest()}],
      [
        'F',
        'show or hide the cameras',
        {f: ({switches}) => toggled(switches, 'frusta', false, true)},
      ],
      ['C', 'render, slider, blend, photo', {c: ({compare}) => compare.next()}],
      ['X, held; Space, held', 'show the photo (Space: where nothing moves)'],
      [
        'M',
        'PSNR of the render against the photo',
        {m: viewer => measurePsnr(viewer).catch(fail(viewer))},
      ],
    ],
  },
  {
    title: 'Picture and tools',
    rows: [
      [
        '1 2 3',
        'color, depth, normals',
        {
          1: ({switches}) => switches.set('show', 'color'),
          2: ({switches}) => switches.set('show', 'depth'),
          3: ({switches}) => switches.set('show', 'normal'),
        },
      ],
      [
        '4',
        'colors: neutral, or as the photo',
        {4: ({hasLooks, switches}) => hasLooks && toggled(switches, 'colors', 'neutral', 'photo')},
      ],
      [
        '5',
        'splats or points',
        {5: ({switches}) => switches.set('points', switches.get('points') ? 0 : 2)},
      ],
      ['K', 'save a screenshot', {k: viewer => viewer.tools.picture.take(1).catch(fail(viewer))}],
      ['T', 'tools: picture, measure, crop, lasso, path', {t: ({panels}) => panels.tools.toggle()}],
      ['V', 'add this view to the path', {v: ({tools}) => tools.path.add()}],
      ['Ctrl+Z', 'take back the last corner or stroke of the lasso'],
      ['Back, Forward', 'the places that were jumped to'],
    ],
  },
  {
    title: 'Time, where the scene moves',
    visitors: true,
    moves: true,
    rows: [
      ['Space', 'play, pause'],
      [
        ', .',
        'a hundredth back, ahead',
        {',': ({player}) => player?.nudge(-1), '.': ({player}) => player?.nudge(1)},
      ],
      [
        'Home End',
        'begin, end',
        {Home: ({player}) => player?.seek(0), End: ({player}) => player?.seek(1)},
      ],
      [
        '[ ]',
        'slower, faster',
        {'[': ({player}) => player?.changeSpeed(-1), ']': ({player}) => player?.changeSpeed(1)},
      ],
      ['J', 'loop', {j: ({player}) => player?.setLoop(!player.loops)}],
    ],
  },
  {
    title: 'Page',
    rows: [
      ['I', 'model panel', {i: ({panels}) => panels.model.toggle()}],
      ['G', 'list of cameras', {g: ({panels}) => panels.cameras?.toggle()}],
      ['P', 'settings', {p: ({panels}) => panels.settings.toggle()}],
      ['H', 'hide everything but the picture', {h: viewer => viewer.setInterface(viewer.isBare)}],
      ['?', 'this help', {'?': ({help}) => help.showModal()}],
      [
        'Esc',
        'close',
        {Escape: ({panels}) => Object.values(panels).forEach(panel => panel.toggle(false))},
      ],
    ],
  },
];
const OF_ALL_PAGES = ['h', '?']; // beside the groups for visitors, whose help is short

/// The groups that a page's help shows.
export function shownGroups({visitors, moves}) {
  const ofVisitors = ({title, rows}) => ({title, rows: rows.filter(row => row[2] !== FOR_CAMERAS)});
  const keys = visitors ? KEYS.filter(group => group.visitors && (moves || !group.moves)) : KEYS;
  const [mouse, fingers] = visitors ? [MOUSE, FINGERS].map(ofVisitors) : [MOUSE, FINGERS];
  return {mouse, fingers, keys};
}

function actionsOf({visitors}) {
  const actions = {};
  for (const group of KEYS)
    for (const [, , keys] of group.rows)
      for (const [key, act] of Object.entries(keys ?? {}))
        if (!visitors || group.visitors || OF_ALL_PAGES.includes(key)) actions[key] = act;
  return actions;
}

export function bindKeys(viewer) {
  const {controls, compare, player, toolPanel} = viewer;
  const actions = actionsOf(viewer.scene);
  const types = target =>
    target.closest?.('input:not([type=range]), select, textarea, dialog') !== null;
  addEventListener('keydown', event => {
    if (types(event.target)) return;
    if (event.ctrlKey || event.metaKey) {
      const isUndo = event.key.toLowerCase() === 'z' && !event.shiftKey;
      if (isUndo && toolPanel.undo()) event.preventDefault();
      return;
    }
    const isFlip = event.key.toLowerCase() === 'x' || (event.key === ' ' && !player);
    if (isFlip && !event.target.closest?.('button')) {
      compare.flip(true);
      return event.preventDefault();
    }
    if (event.key === ' ' && !event.target.closest?.('button')) {
      if (!event.repeat) player.toggle();
      return event.preventDefault();
    }
    if (controls.press(event)) return event.preventDefault();
    const ranges = event.target.closest?.('input[type=range]') && event.key.startsWith('Arrow');
    const steps = [',', '.'].includes(event.key);
    const act = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (
      !act ||
      (event.repeat && !steps && !event.key.startsWith('Arrow')) ||
      ranges ||
      event.altKey
    )
      return;
    event.preventDefault();
    act(viewer);
  });
  addEventListener('keyup', event => {
    controls.release(event);
    if ([' ', 'x', 'X'].includes(event.key)) compare.flip(false);
  });
}
