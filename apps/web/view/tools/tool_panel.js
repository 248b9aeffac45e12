// SPDX-License-Identifier: Apache-2.0
// The panel of tools, of which one is open at a time.
import {el, segmented} from '../../shared/dom.js';
import {CropTool} from './crop_tool.js';
import {LassoTool} from './lasso_tool.js';
import {MeasureTool} from './measure_tool.js';
import {PathTool} from './path_tool.js';
import {PictureTool} from './picture_tool.js';

/// The tools of a viewer by name. With frames from the server, those that need no Gaussians.
export function makeTools(viewer) {
  const drawn = viewer.stage.isRemote
    ? {}
    : {measure: new MeasureTool(viewer), crop: new CropTool(viewer), lasso: new LassoTool(viewer)};
  return {picture: new PictureTool(viewer), ...drawn, path: new PathTool(viewer)};
}

export class ToolPanel {
  // tools: each has title, node, draw(overlay), and maybe opened(), closed(), and picks with
  // pick(x, y); overlay: over which they draw; changed(): called after another one was opened
  constructor(tools, overlay, changed) {
    this.tools = tools;
    for (const tool of tools) overlay.add(tool);
    this.changed = changed;
    this.isShown = false;
    this.holder = el('div.tool-holder');
    this.choice = segmented(
      'tool',
      tools.map(({title}) => [title, title]),
      tools[0].title,
      title => this.open(title),
    );
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

  /// Takes back the last click of the open tool; false: there is none.
  undo() {
    return this.picker?.undo?.() ?? false;
  }

  /// The tool that clicks into the picture are for, or null.
  get picker() {
    return this.isShown && this.chosen.picks ? this.chosen : null;
  }
}
