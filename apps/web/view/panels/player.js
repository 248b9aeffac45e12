// SPDX-License-Identifier: Apache-2.0
// Plays a model that moves: the bar with the time, and the clock behind it.
import {el} from '../../shared/dom.js';
import {fixed} from '../../shared/format.js';
import {icon} from './icons.js';
import {iconButton} from './parts.js';

const USUAL_SECONDS = 10; // of a scene whose file does not say its duration
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
const NUDGE = 0.01; // of the scene, by the keys , and .
const RANGE_STEPS = 1000;

/// Times are 0 to 1, in the scene's duration.
export class Player {
  // show(time): draws that time; wake(): asks for frames, in each of which step() is called
  constructor({time, show, wake}) {
    Object.assign(this, {show, wake});
    this.duration = 0; // seconds; 0: not known
    this.loaded = 0; // the model is there up to this time
    this.speed = 1;
    this.loops = true;
    this.isPlaying = false;
    this.playButton = iconButton('play', 'play (Space)', () => this.toggle());
    this.range = el('input.time-range', {
      type: 'range',
      min: 0,
      max: RANGE_STEPS,
      step: 1,
      'aria-label': 'time',
      oninput: () => this.seek(this.range.value / RANGE_STEPS),
    });
    this.clock = el('output.time-clock');
    this.loopButton = iconButton('loop', 'loop (J)', () => this.setLoop(!this.loops), {
      'aria-pressed': 'true',
    });
    this.speeds = el(
      'select.time-speed',
      {
        'aria-label': 'speed',
        onchange: () => {
          this.speed = Number(this.speeds.value);
        },
      },
      SPEEDS.map(speed => el('option', {value: speed, selected: speed === 1}, `×${speed}`)),
    );
    this.node = el(
      'div.time-bar',
      {role: 'group', 'aria-label': 'time of the scene'},
      this.playButton,
      this.range,
      this.clock,
      this.speeds,
      this.loopButton,
    );
    this.set(time);
  }

  get seconds() {
    return this.duration || USUAL_SECONDS;
  }

  // A model that is loaded up to this time.
  take({duration, loaded}) {
    this.duration = duration;
    this.loaded = loaded;
    this.node.style.setProperty('--loaded', `${100 * Math.min(1, loaded)}%`);
    this.showClock();
    this.wake();
  }

  set(time) {
    this.time = time;
    this.range.value = Math.round(RANGE_STEPS * time);
    this.showClock();
    this.show(time);
  }
  showClock() {
    const text = this.duration
      ? `${fixed(this.time * this.duration, 2)} / ${fixed(this.duration, 1)} s`
      : fixed(this.time, 3);
    if (this.clock.textContent !== text) this.clock.textContent = text;
  }

  // Goes to a time by hand, and stays there.
  seek(time) {
    this.play(false);
    this.set(Math.min(1, Math.max(0, time)));
  }
  nudge(by) {
    this.seek(this.time + by * NUDGE);
  }

  play(on) {
    if (on === this.isPlaying) return;
    if (on && this.time >= 1) this.set(0);
    this.isPlaying = on;
    this.last = null;
    this.playButton.replaceChildren(icon(on ? 'pause' : 'play'));
    const label = `${on ? 'pause' : 'play'} (Space)`;
    this.playButton.title = label;
    this.playButton.setAttribute('aria-label', label);
    this.wake();
  }
  toggle() {
    this.play(!this.isPlaying);
  }
  setLoop(on) {
    this.loops = on;
    this.loopButton.setAttribute('aria-pressed', String(on));
  }
  changeSpeed(by) {
    this.speeds.selectedIndex = Math.min(
      SPEEDS.length - 1,
      Math.max(0, this.speeds.selectedIndex + by),
    );
    this.speed = Number(this.speeds.value);
  }

  // Goes on in each frame. Waits where the model is not loaded yet.
  step(now) {
    if (!this.isPlaying) return;
    const elapsed = this.last === null ? 0 : (now - this.last) / 1000;
    this.last = now;
    let next = this.time + (elapsed * this.speed) / this.seconds;
    if (next > this.loaded && this.loaded < 1) next = Math.max(this.time, this.loaded);
    if (next > 1 && this.loops) next %= 1;
    if (next !== this.time) this.set(Math.min(1, next));
    if (next >= 1 && !this.loops) this.play(false);
  }
}
