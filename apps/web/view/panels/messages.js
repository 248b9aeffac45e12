// SPDX-License-Identifier: Apache-2.0
// Messages at the bottom of the page: errors in words, and a progress bar while the model loads.
import {el} from '../../shared/dom.js';
import {iconButton} from './parts.js';

export class Messages {
  constructor() {
    this.list = el('div.message-list', {role: 'alert'});
    this.bars = el('div.bar-list');
    this.node = el('div.messages', {}, this.bars, this.list);
    this.troubles = new Map();
  }

  add(text) {
    const message = el(
      'div.message',
      {},
      el('p', {}, text),
      iconButton('close', 'close this message', () => message.remove()),
    );
    this.list.append(message);
    return message;
  }

  // An error, shown until it is closed. The same words are not shown twice.
  fail(error) {
    console.warn(error);
    if (![...this.list.children].some(each => each.textContent === error.message))
      this.add(error.message);
  }

  // A condition that may end by itself, such as a server that does not answer: `error`, or null
  // when it has ended.
  trouble(what, error) {
    const shown = this.troubles.get(what);
    if (shown?.text === error?.message) return;
    shown?.node.remove();
    this.troubles.delete(what);
    if (error) this.troubles.set(what, {text: error.message, node: this.add(error.message)});
  }

  // A progress bar until end(); without words nothing is shown.
  progress(words) {
    if (!words) return {set() {}, end() {}};
    const share = el('progress', {max: 1, 'aria-label': words}),
      text = el('span', {}, words);
    const node = el('div.loading', {role: 'status'}, text, share);
    this.bars.append(node);
    return {
      set: value => {
        share.value = value;
        text.textContent =
          value < 1 ? `${words}: ${Math.floor(100 * value)}%` : 'Preparing the model';
        if (value >= 1) share.removeAttribute('value');
      },
      end: () => node.remove(),
    };
  }
}
