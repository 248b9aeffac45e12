// SPDX-License-Identifier: Apache-2.0
// Takes texts and files out of the page.
import {el} from '../../shared/dom.js';

const SHOWN = 1200; // milliseconds of "copied"

// Over plain http to another machine there is no clipboard: a selected text can be copied by hand.
async function copy(text) {
  if (navigator.clipboard) return navigator.clipboard.writeText(text);
  const area = el('textarea', {'aria-label': 'text to copy'});
  area.value = text;
  document.body.append(area);
  area.select();
  const isCopied = document.execCommand('copy');
  area.remove();
  if (!isCopied) throw new Error('The browser does not let this page copy.');
}

/// A name as a word of a shell, which is no option.
export function quoted(name) {
  const safe = name.startsWith('-') ? `./${name}` : name;
  return /^[\w./-]+$/.test(safe) ? safe : `'${safe.replaceAll("'", "'\\''")}'`;
}

/// A button that copies text().
export function copyButton(words, text) {
  const button = el(
    'button.button',
    {
      type: 'button',
      onclick: async () => {
        button.textContent = await copy(text()).then(
          () => 'copied',
          () => 'the browser refused',
        );
        setTimeout(() => {
          button.textContent = words;
        }, SHOWN);
      },
    },
    words,
  );
  return button;
}

/// Lets the browser save a blob as a file of this name.
export function save(blob, name) {
  const url = URL.createObjectURL(blob);
  const link = el('a', {href: url, download: name.replaceAll(/[^\w.-]+/g, '_')});
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
