// SPDX-License-Identifier: Apache-2.0
// Short ways to make elements. Children that are strings become text nodes, so that no name in the
// data can become markup.

function append(node, children) {
  for (const child of children.flat(Infinity))
    if (child !== null && child !== undefined && child !== false) node.append(child);
  return node;
}

// el('p.note', {title: '...'}, 'text', el('b', {}, 'more')). Properties that begin with "on" are
// listeners.
export function el(what, properties = {}, ...children) {
  const [tag, ...classes] = what.split('.');
  const node = document.createElement(tag);
  if (classes.length) node.className = classes.join(' ');
  for (const [name, value] of Object.entries(properties)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith('on')) node.addEventListener(name.slice(2), value);
    else node.setAttribute(name, value === true ? '' : value);
  }
  return append(node, children);
}

// The same in SVG.
export function svg(tag, attributes = {}, ...children) {
  const node = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  return append(node, children);
}

// A row of buttons of which one is pressed. choices: [[value, label], ...]. press(value) shows
// another one as pressed without calling choose().
export function segmented(label, choices, chosen, choose) {
  const buttons = choices.map(([value, text]) =>
    el(
      'button',
      {
        type: 'button',
        'data-value': value,
        onclick: () => {
          press(value);
          choose(value);
        },
      },
      text,
    ),
  );
  const press = value =>
    buttons.forEach(button =>
      button.setAttribute('aria-pressed', String(button.dataset.value === value)),
    );
  press(chosen);
  return Object.assign(el('div.segmented', {role: 'group', 'aria-label': label}, buttons), {press});
}

export function section(id, title, aside, ...children) {
  return el(
    'section',
    {id, 'aria-labelledby': `${id}-title`},
    el('div.section-head', {}, el('h2', {id: `${id}-title`}, title), aside),
    children,
  );
}

// rows: lists of cells, each a text, a node, or {text, align: 'number', title, className}.
export function table(head, rows, options = {}) {
  const cell = (tag, value) => {
    const given =
      value && typeof value === 'object' && !(value instanceof Node) ? value : {text: value};
    const classes = [given.align === 'number' && 'number', given.className].filter(Boolean);
    return el(
      [tag, ...classes].join('.'),
      {title: given.title, scope: tag === 'th' ? 'col' : null},
      given.text,
    );
  };
  return el(
    'div.scroll',
    {tabindex: '0', role: 'region', 'aria-label': options.label ?? 'table'},
    el(
      'table',
      {},
      el(
        'thead',
        {},
        el(
          'tr',
          {},
          head.map(value => cell('th', value)),
        ),
      ),
      el(
        'tbody',
        {},
        rows.map(row =>
          el(
            'tr',
            {},
            row.map(value => cell('td', value)),
          ),
        ),
      ),
    ),
  );
}

export function cssColor(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}
