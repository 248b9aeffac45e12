// SPDX-License-Identifier: Apache-2.0
// The views of a run: photo, render and error, two at a time with a slider between them, and a
// table of all views.
import {el, section, segmented, table} from '../shared/dom.js';
import {fixed, isNumber} from '../shared/format.js';

// What views have besides PSNR. Runs of earlier versions have SSIM alone.
const FIGURES = [
  {key: 'ssim', name: 'SSIM'},
  {key: 'flip', name: 'FLIP'},
  {key: 'lpips', name: 'LPIPS'},
  {key: 'psnr_panorama', name: 'panorama PSNR'},
  {key: 'ws_psnr', name: 'WS-PSNR'},
  {key: 'ssim_panorama', name: 'panorama SSIM'},
  {key: 'depth_error', name: 'depth error'},
];
const PICTURES = {photo: 'photo', render: 'render', error: 'error ×4', flip_picture: 'FLIP'};
const PAIRS = [
  ['photo render', 'photo | render'],
  ['render error', 'render | error'],
  ['photo flip_picture', 'photo | FLIP'],
];

// data.views: {split, total, list: [{name, psnr, ssim, flip, lpips, photo, render, error, flip_picture}]}. Views without
// pictures are only in the table.
export function views({split, total, list}) {
  const pictured = list.filter(view => view.photo);
  const count =
    pictured.length < total ? `pictures of ${pictured.length} of ${total} views` : `${total} views`;
  return section(
    'views',
    split === 'test' ? 'Test views' : 'Training views',
    el('span.muted', {}, count),
    pictured.length > 0 && viewer(pictured),
    allViews(list, pictured),
  );
}

let select = () => {}; // shows a view in the viewer of this page

function viewer(list) {
  let at = 0,
    pair = PAIRS[0][0].split(' ');
  const [back, front] = [el('img.back'), el('img.front')];
  const tags = [el('span.tag.left'), el('span.tag.right')];
  const range = el('input', {
    type: 'range',
    min: 0,
    max: 1000,
    value: 500,
    step: 10,
    'aria-label': 'border between the left and the right picture',
    oninput: () => place(range.value / 1000),
  });
  const stage = el(
    'div.stage',
    {},
    back,
    front,
    tags,
    el('div.divider', {'aria-hidden': 'true'}, el('span.grip')),
    range,
  );
  const place = share => {
    range.value = Math.round(share * 1000);
    stage.style.setProperty('--share', `${(100 * share).toFixed(1)}%`);
    range.setAttribute('aria-valuetext', `${Math.round(100 * share)}% ${PICTURES[pair[0]]}`);
  };
  const follow = event => {
    const box = stage.getBoundingClientRect();
    place(Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)));
  };
  stage.addEventListener('pointerdown', event => {
    stage.setPointerCapture(event.pointerId);
    range.focus({preventScroll: true});
    follow(event);
    event.preventDefault();
  });
  stage.addEventListener('pointermove', event => {
    if (stage.hasPointerCapture(event.pointerId)) follow(event);
  });

  const name = el('h3.view-name');
  const figures = el('p.figures');
  const choice = el(
    'select',
    {'aria-label': 'view', onchange: () => show(Number(choice.value))},
    list.map((view, i) => el('option', {value: i}, view.name)),
  );
  const thumbs = list.map((view, i) =>
    el(
      'button.thumb',
      {type: 'button', 'aria-label': `view ${view.name}`, onclick: () => show(i)},
      el('img', {src: view.render, alt: '', loading: 'lazy'}),
      el('span', {}, isNumber(view.psnr) ? `${fixed(view.psnr, 1)} dB` : '–'),
    ),
  );
  const draw = () => {
    const view = list[at];
    [front, back].forEach((image, i) => {
      image.src = view[pair[i]];
      image.alt = `${PICTURES[pair[i]]} of ${view.name}`;
      tags[i].textContent = PICTURES[pair[i]];
    });
    stage.style.aspectRatio = `${view.width} / ${view.height}`;
    stage.style.setProperty('--ratio', view.width / view.height);
    name.textContent = view.name;
    figures.replaceChildren(
      el('b', {}, fixed(view.psnr, 2)),
      ' dB PSNR',
      ...FIGURES.filter(({key}) => isNumber(view[key])).flatMap(({key, name}) => [
        el('span.dot', {}, '·'),
        el('b', {}, fixed(view[key], 4)),
        ` ${name}`,
      ]),
    );
    choice.value = String(at);
    thumbs.forEach((thumb, i) => thumb.setAttribute('aria-current', String(i === at)));
    place(range.value / 1000);
  };
  const show = index => {
    at = (index + list.length) % list.length;
    draw();
    const strip = thumbs[at].parentElement;
    if (strip)
      strip.scrollTo({
        left: thumbs[at].offsetLeft - (strip.clientWidth - thumbs[at].offsetWidth) / 2,
      });
  };
  select = view => {
    show(list.indexOf(view));
    stage.scrollIntoView({block: 'center'});
  };
  const arrow = (label, text, step) =>
    el(
      'button.button',
      {type: 'button', 'aria-label': label, onclick: () => show(at + step)},
      text,
    );
  draw();
  return el(
    'div.card.viewer',
    {},
    el(
      'div.viewer-head',
      {},
      el('div', {}, name, figures),
      el(
        'div.controls',
        {},
        segmented('pictures', PAIRS, PAIRS[0][0], value => {
          pair = value.split(' ');
          draw();
        }),
        list.length > 1 &&
          el('div.turn', {}, arrow('previous view', '‹', -1), choice, arrow('next view', '›', 1)),
      ),
    ),
    stage,
    el(
      'p.note.muted',
      {},
      'Drag, or use the arrow keys. The error is the mean absolute difference of the channels, times four: ' +
        'black is no error, pale yellow a quarter of the range or more. FLIP is the difference that somebody sees who alternates ' +
        'between these two pictures: black is none, pale yellow the largest.',
    ),
    list.length > 1 && el('div.thumbs', {}, thumbs),
  );
}

function allViews(list, pictured) {
  const figures = list.map(view => view.psnr).filter(isNumber);
  if (!figures.length) return null;
  const [low, high] = [Math.min(...figures), Math.max(...figures)];
  const bar = value =>
    el('span.bar', {
      style: `--length:${isNumber(value) ? 8 + (92 * (value - low)) / (high - low || 1) : 0}%`,
    });
  const worstFirst = [...list].sort((a, b) => (a.psnr ?? 1e9) - (b.psnr ?? 1e9));
  const columns = FIGURES.filter(({key}) => list.some(view => isNumber(view[key])));
  return el(
    'details.card.all-views',
    {},
    el('summary', {}, `metrics of all ${list.length} views, worst first`),
    table(
      [
        'view',
        {text: 'PSNR / dB', align: 'number'},
        ...columns.map(({name}) => ({text: name, align: 'number'})),
        'PSNR, from worst to best',
      ],
      worstFirst.map(view => [
        pictured.includes(view)
          ? el('button.link', {type: 'button', onclick: () => select(view)}, view.name)
          : view.name,
        {text: fixed(view.psnr, 2), align: 'number'},
        ...columns.map(({key}) => ({text: fixed(view[key], 4), align: 'number'})),
        {text: bar(view.psnr), className: 'bar-cell'},
      ]),
      {label: 'metrics of all views'},
    ),
  );
}
