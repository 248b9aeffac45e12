// SPDX-License-Identifier: Apache-2.0
// The parts that both kinds of report share: head, tiles, notes, facts, foot.
import {el, section} from '../shared/dom.js';

// The logo, drawn by page.css.
function mark() {
  return el('span.mark', {'aria-hidden': 'true'});
}

// sections: [[id, title], ...]
export function head({title, over, under, chips, sections}) {
  return [
    el(
      'nav.top',
      {'aria-label': 'sections'},
      el(
        'div.top-inner',
        {},
        el('span.brand', {}, mark(), 'gemsplat'),
        el(
          'div.links',
          {},
          sections.map(([id, name]) => el('a', {href: `#${id}`}, name)),
        ),
      ),
    ),
    el(
      'header.head',
      {},
      el('p.over', {}, over),
      el('h1', {}, title),
      under && el('p.muted.under', {}, under),
      el(
        'div.chips',
        {},
        chips
          .filter(Boolean)
          .map(([text, kind]) => el(`span.chip${kind ? `.${kind}` : ''}`, {}, text)),
      ),
    ),
  ];
}

// The large numbers at the top. list: [{name, value, unit, more}]
export function tiles(list) {
  return el(
    'dl.tiles',
    {},
    list
      .filter(Boolean)
      .map(({name, value, unit, more}) =>
        el(
          'div.card.tile',
          {},
          el('dt', {}, name),
          el('dd', {}, el('span.value', {}, value), unit && el('span.unit', {}, ` ${unit}`)),
          more && el('dd.more', {}, more),
        ),
      ),
  );
}

export function notes(list) {
  if (!list?.length) return null;
  return el(
    'aside.card.notes',
    {'aria-label': 'notes'},
    list.map(note => el('p', {}, note)),
  );
}

// A section of names and values. list: [[name, value], ...]; entries without a value are left out.
export function facts(id, title, list) {
  const known = list.filter(([, value]) => value !== null && value !== undefined && value !== '');
  return section(
    id,
    title,
    null,
    el(
      'div.card',
      {},
      el(
        'dl.facts',
        {},
        known.map(([name, value]) =>
          el('div', {}, el('dt', {}, name), el('dd', {}, String(value))),
        ),
      ),
    ),
  );
}

export function foot(data) {
  return el(
    'footer.muted',
    {},
    `Written by gemsplat ${data.made.version} (${data.made.commit}) on ${data.made.date}. `,
    'This file is complete: it opens without a network.',
  );
}

export const shortCommit = commit => commit?.replace(/^([0-9a-f]{10})[0-9a-f]+/, '$1');
