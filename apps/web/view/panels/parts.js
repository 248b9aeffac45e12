// SPDX-License-Identifier: Apache-2.0
// The building blocks of the viewer's panels: buttons, switches, sliders, lists of facts.
import {el} from '../../shared/dom.js';
import {icon} from './icons.js';

export const iconButton = (name, label, onclick, properties = {}) =>
  el(
    'button.icon-button',
    {type: 'button', 'aria-label': label, title: label, onclick, ...properties},
    icon(name),
  );

/// A panel and the button that opens and closes it: {node, button, toggle(open), isOpen}. The
/// button's icon has the panel's name. changed(open) is called after each change.
export function panel(name, title, body, changed = () => {}) {
  const id = `panel-${name}`;
  const node = el(
    `aside.panel.${name}`,
    {id, hidden: true, 'aria-label': title},
    el(
      'div.panel-head',
      {},
      el('h2', {}, title),
      iconButton('close', `close ${title}`, () => toggle(false)),
    ),
    el('div.panel-body', {}, body),
  );
  const button = iconButton(name, title, () => toggle(), {
    'aria-controls': id,
    'aria-expanded': 'false',
  });
  const toggle = (open = node.hidden) => {
    if (open === !node.hidden) return;
    node.hidden = !open;
    button.setAttribute('aria-expanded', String(open));
    changed(open);
  };
  return {
    node,
    button,
    toggle,
    get isOpen() {
      return !node.hidden;
    },
  };
}

/// A line of settings: its name and its control.
export const row = (label, control, note) =>
  el('div.row', {}, el('span.row-label', {}, label), control, note && el('p.note.muted', {}, note));

export function toggleSwitch(label, isOn, choose) {
  const button = el(
    'button.switch',
    {
      type: 'button',
      role: 'switch',
      'aria-label': label,
      onclick: () => {
        set(button.getAttribute('aria-checked') !== 'true');
        choose(button.getAttribute('aria-checked') === 'true');
      },
    },
    el('span.knob'),
  );
  const set = on => button.setAttribute('aria-checked', String(on));
  set(isOn);
  return {button, set};
}

export function slider(label, {min, max, step, value}, text, input) {
  const shown = el('output', {}, text(value));
  const range = el('input', {
    type: 'range',
    min,
    max,
    step,
    value,
    'aria-label': label,
    oninput: () => {
      shown.textContent = text(Number(range.value));
      input(Number(range.value));
    },
  });
  const set = value => {
    range.value = value;
    shown.textContent = text(value);
  };
  return {node: el('span.slider', {}, range, shown), set};
}

/// A list of facts with these names. `set(name, value)` changes one; it is hidden while its value
/// is null.
export function factList(names) {
  const rows = new Map(names.map(name => [name, el('dd')]));
  const node = el(
    'dl.facts',
    {},
    names.map(name =>
      el('div', {hidden: true, 'data-fact': name}, el('dt', {}, name), rows.get(name)),
    ),
  );
  const set = (name, value) => {
    const cell = rows.get(name);
    cell.parentElement.hidden = value === null || value === undefined || value === '';
    if (cell.textContent !== String(value)) cell.textContent = String(value ?? '');
  };
  return {node, set};
}
