// SPDX-License-Identifier: Apache-2.0
// The panel of tools, of which one is open at a time.
import {el, segmented} from '../../shared/dom.js';

export class ToolPanel {
  // tools: each has title, node, draw(overlay), and maybe opened(), closed(), and picks with
  // pick(x, y); changed(): called after another one was opened
  constructor(tools, changed) {
    this.tools = tools;
    this.changed = changed;
    this.isShown = false;
    this.holder = el('div.tool-holder');
    this.choice = segmented('tool', tools.map(({title}) => [title, title]), tools[0].title, title => this.open(title));
    this.node = el('div.tools-body', {}, this.choice, this.holder);
    this.open(tools[0].title);
  }

  open(title) {
    if (this.isShown) this.chosen.closed?.();
    this.chosen = this.tools.find(tool => tool.title === title);
    this.choice.press(title);
    this.holder.replaceChildren(this.chosen.node);
    if (this.isShown) this.chosen.opened?.();
    this.changed();
  }

  // The panel was opened or closed.
  show(isShown) {
    this.isShown = isShown;
    this.chosen[isShown ? 'opened' : 'closed']?.();
    this.changed();
  }

  /// The tool that clicks into the picture are for, or null.
  get picker() { return this.isShown && this.chosen.picks ? this.chosen : null; }
}
