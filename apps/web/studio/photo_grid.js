// SPDX-License-Identifier: Apache-2.0
// The photos of a project as tiles. Each can be left out, turned and masked; the photos themselves
// stay as they are.
import {el, svg} from '../shared/dom.js';
import {whole} from '../shared/format.js';
import {button} from './jobs.js';
import {openMask} from './mask.js';

const SHOWN_AT_ONCE = 120;
const TURN = 'M20 12a8 8 0 1 1-2.5-5.8M20 3v5h-5', // icons of 24 x 24
  BRUSH =
    'M4 20c4 .4 6-.9 6-3.2a2.6 2.6 0 0 0-5.2 0C4.8 18.4 4.6 19.2 4 20zM9.5 14l9-9.5 1.5 1.5-9 9.5';

export const thumbOf = ({server, details}, name) => server.thumb(name, details.turned[name] ?? 0);

/// Leaves photos out, or takes them in again.
export async function leaveOut(app, names, isOut) {
  const left = new Set(app.details.left_out);
  for (const name of names) left[isOut ? 'add' : 'delete'](name);
  app.details.left_out = app.details.pictures.filter(name => left.has(name));
  await app.act(server => server.change({left_out: app.details.left_out}));
}

async function turn(app, name) {
  const {turned} = app.details; // of which a second press knows
  turned[name] = ((turned[name] ?? 0) + 90) % 360;
  await app.act(server => server.change({turned}));
}

// Whether the scene was made of photos that were turned otherwise.
function isSceneOlder({details, project}) {
  const made = project.jobs.find(
    ({words}) => words[0] === 'reconstruct' && words[words.indexOf('-o') + 1] === details.scene,
  );
  const marks = turned =>
    Object.entries(turned ?? {})
      .sort()
      .join();
  return Boolean(made) && marks(made.turned) !== marks(details.turned);
}

function wordsOn(app) {
  const {pictures, left_out: out, masked, has_own_masks: hasOwnMasks} = app.details,
    count = pictures.filter(name => masked[name]).length;
  return [
    `${whole(pictures.length - out.length)} of ${whole(pictures.length)} photos are used. Press a photo to leave it out.`,
    count > 0 &&
      `${count === 1 ? '1 photo has' : `${whole(count)} photos have`} masked parts, which are not trained.`,
    hasOwnMasks &&
      'Masks lie beside the photos, and training uses them; so none are painted here, and no photo is turned.',
    isSceneOlder(app) && 'Photos were turned; find the cameras again, so that it counts.',
  ]
    .filter(Boolean)
    .join(' ');
}

const tool = (kind, label, name, path, onclick) =>
  el(
    'button.tile-tool',
    {
      type: 'button',
      id: `${kind} ${name}`,
      title: label,
      'aria-label': `${label}: ${name}`,
      onclick,
    },
    svg('svg', {viewBox: '0 0 24 24', 'aria-hidden': 'true'}, svg('path', {d: path})),
  );

function tile(app, name) {
  const {details, server} = app,
    isOut = details.left_out.includes(name),
    canTurn =
      details.scene !== details.photos && (!details.has_own_masks || details.turned[name] > 0),
    time = details.masked[name];
  return el(
    'div.tile',
    {'data-out': isOut},
    el(
      'button.tile-press',
      {
        type: 'button',
        title: name,
        'aria-pressed': String(!isOut),
        onclick: () => leaveOut(app, [name], !app.details.left_out.includes(name)),
      },
      el('img', {src: thumbOf(app, name), loading: 'lazy', alt: ''}),
      time &&
        el('img.tile-mask', {
          src: server.mask(name, details.turned[name] ?? 0, time),
          loading: 'lazy',
          alt: 'partly masked',
        }),
      el('span', {}, name),
    ),
    el(
      'div.tile-tools',
      {},
      canTurn && tool('turn', 'Turn right', name, TURN, () => turn(app, name)),
      !details.has_own_masks &&
        tool('mask', 'Mask parts', name, BRUSH, () => openMask(app, name).catch(app.fail)),
    ),
  );
}

export function photoGrid(app) {
  const {pictures} = app.details,
    grid = el('div.grid');
  const show = count => {
    const first = grid.childElementCount;
    grid.append(...pictures.slice(first, count).map(name => tile(app, name)));
    more.hidden = count >= pictures.length;
    app.memory.tiles = count;
  };
  const more = button('Show all photos', () => show(pictures.length));
  show(app.memory.tiles ?? SHOWN_AT_ONCE);
  return el(
    'section',
    {},
    el('h2', {}, 'Photos'),
    el('p.said', {'aria-live': 'polite'}, wordsOn(app)),
    grid,
    more,
  );
}
