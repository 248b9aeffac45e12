// SPDX-License-Identifier: Apache-2.0
// What went wrong, in words, and how far loading is.
import {el} from '../shared/dom.js';
import {iconButton} from './parts.js';

export class Messages {
  constructor() {
    this.list = el('div.message-list', {role: 'alert'});
    this.bars = el('div.bar-list');
    this.node = el('div.messages', {}, this.bars, this.list);
    this.troubles = new Map();
  }

  add(text) {
    const message = el('div.message', {}, el('p', {}, text), iconButton('close', 'close this message', () => message.remove()));
    this.list.append(message);
    return message;
  }

  // Stays until it is closed; the same words do not come twice.
  fail(error) {
    console.warn(error);
    if (![...this.list.children].some(each => each.textContent === error.message)) this.add(error.message);
  }

  // Something that may mend by itself: `error`, or null where it has.
  trouble(what, error) {
    const shown = this.troubles.get(what);
    if (shown?.text === error?.message) return;
    shown?.node.remove();
    this.troubles.delete(what);
    if (error) this.troubles.set(what, {text: error.message, node: this.add(error.message)});
  }

  // A bar until end(); without words none is seen.
  progress(words) {
    if (!words) return {set() {}, end() {}};
    const share = el('progress', {max: 1, 'aria-label': words}), text = el('span', {}, words);
    const node = el('div.loading', {role: 'status'}, text, share);
    this.bars.append(node);
    return {
      set: value => {
        share.value = value;
        text.textContent = value < 1 ? `${words}: ${Math.floor(100 * value)}%` : 'Preparing the model';
        if (value >= 1) share.removeAttribute('value');
      },
      end: () => node.remove(),
    };
  }
}
