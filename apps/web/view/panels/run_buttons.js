// SPDX-License-Identifier: Apache-2.0
// Buttons that pause, save and stop a run. The server carries out what comes with its token, which
// stands after #control= in the address that the program printed.
import {el} from '../../shared/dom.js';
import {whole} from '../../shared/format.js';
import {askToControl} from '../server.js';

const SURE = 4000; // milliseconds in which a second press stops the run
const KEY = 'gemsplat-control';

/// Takes the token out of the address, where it would be shared, and keeps it for this tab.
export function takeToken() {
  const options = new URLSearchParams(location.hash.slice(1)),
    token = options.get('control');
  if (token === null) return sessionStorage.getItem(KEY);
  options.delete('control');
  history.replaceState(null, '', `#${options}`);
  sessionStorage.setItem(KEY, token);
  return token;
}

export class RunButtons {
  // failed(error); asked(): after each request that the server took
  constructor(token, {failed, asked}) {
    Object.assign(this, {token, failed, asked});
    const button = (text, onclick) => el('button.button', {type: 'button', onclick}, text);
    this.pause = button('Pause', () => this.ask(this.isPaused ? 'resume' : 'pause'));
    this.save = button('Save now', () => this.ask('save'));
    this.stop = button('Stop', () => this.stopIfSure());
    this.said = el('p.said', {'aria-live': 'polite'});
    this.node = token
      ? el(
          'div.run-buttons',
          {},
          el('div.row.buttons', {}, this.pause, this.save, this.stop),
          this.said,
        )
      : el(
          'p.muted.note',
          {},
          'To pause, save or stop the run, open the address that gemsplat printed.',
        );
    this.node.hidden = true;
  }

  async ask(what) {
    try {
      await askToControl(what, this.token);
      this.isStopping ||= what === 'stop'; // the server may end before it is asked again
      this.asked();
    } catch (error) {
      this.failed(error);
    }
  }

  // A run of days is not stopped by one press.
  stopIfSure() {
    if (!this.isSure) {
      this.isSure = true;
      this.stop.textContent = 'Stop: sure?';
      setTimeout(() => {
        this.isSure = false;
        this.stop.textContent = 'Stop';
      }, SURE);
      return;
    }
    this.ask('stop');
  }

  // control: of the run's state; null where the server offers none
  show(control, isOver) {
    this.node.hidden = !control || isOver;
    if (!control) return;
    this.isPaused = control.paused;
    this.isStopping = control.stopping;
    this.pause.textContent = control.paused ? 'Resume' : 'Pause';
    this.save.disabled = control.saving;
    this.stop.disabled = control.stopping;
    const saved = control.saved === null ? '' : `Saved the model of step ${whole(control.saved)}.`;
    this.said.textContent = control.stopping
      ? 'Stopping: the model is saved.'
      : control.saving
        ? 'Saving.'
        : control.trouble || saved;
  }
}
