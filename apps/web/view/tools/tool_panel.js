// SPDX-License-Identifier: Apache-2.0
// The panel of tools, of which one is open at a time.
import {el, segmented} from '../../shared/dom.js';

export class ToolPanel {
  // tools: each has title, node, draw(overlay), and maybe picks and pick(x, y)
  constructor(tools) {
    this.tools = tools;
    this.holder = el('div.tool-holder');
    this.choice = segmented('tool', tools.map(({title}) => [title, title]), tools[0].title, title => this.open(title));
    this.node = el('div.tools-body', {}, this.choice, this.holder);
    this.open(tools[0].title);
  }

  open(title) {
    this.chosen = this.tools.find(tool => tool.title === title);
    this.choice.press(title);
    this.holder.replaceChildren(this.chosen.node);
  }

  /// The tool that clicks into the picture are for, or null.
  get picker() { return this.isShown && this.chosen.picks ? this.chosen : null; }
}
