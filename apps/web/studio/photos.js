// SPDX-License-Identifier: Apache-2.0
// The screens "Photos" (what doctor says of them; they are left out, turned and masked) and "Cameras".
import {el} from '../shared/dom.js';
import {button, isActive, jobList} from './jobs.js';
import {leaveOut, photoGrid, thumbOf} from './photo_grid.js';
import {projectSettings} from './project.js';
import {check, dropZone, upload} from './start.js';

const MARKS = {good: '✓', note: 'i', warning: '!', fatal: '×'};
const MOST_SHOWN = 8; // photos of a finding
const withoutEnding = name => name.replace(/\.[^./]*$/, '');

function findings(app, {findings: found = []}) {
  const {pictures} = app.details;
  // doctor names photos as the model does, maybe with another ending
  const ownName = name =>
    pictures.find(own => own === name || withoutEnding(own) === withoutEnding(name));
  const row = ({level, topic, text, names}) => {
    const own = names.map(ownName).filter(Boolean);
    return el(
      'li',
      {'data-level': level},
      el('span.mark-of', {title: level}, MARKS[level]),
      el(
        'div',
        {},
        el('b', {}, topic),
        ' ',
        text,
        level !== 'good' &&
          own.length < pictures.length &&
          el(
            'div.strip',
            {},
            own
              .slice(0, MOST_SHOWN)
              .map(name =>
                el('img', {src: thumbOf(app, name), title: name, alt: name, loading: 'lazy'}),
              ),
          ),
      ),
      own.length > 0 &&
        own.length < pictures.length &&
        (level === 'warning' || level === 'fatal') &&
        topic !== 'masks' &&
        button(`Leave out ${own.length === 1 ? 'this photo' : `these ${own.length}`}`, () =>
          leaveOut(app, own, true),
        ),
    );
  };
  const isGood = ({level}) => level === 'good',
    good = found.filter(isGood),
    others = found.filter(finding => !isGood(finding));
  return el(
    'div',
    {},
    el('ul.findings', {}, others.map(row)),
    good.length > 0 &&
      el(
        'details',
        {},
        el(
          'summary',
          {},
          `${good.length} ${good.length === 1 ? 'check' : 'checks'} found nothing wrong`,
        ),
        el('ul.findings', {}, good.map(row)),
      ),
  );
}

export function showPhotos(app) {
  const {details, server} = app,
    checkAgain = () => app.act(check);
  const list = jobList(
    app,
    ['doctor'],
    () => 'Check',
    outcome => findings(app, outcome),
  );
  const {videos, pictures} = details;
  return {
    node: el(
      'main',
      {},
      list.node,
      el(
        'div.buttons',
        {},
        button(list.newest ? 'Check again' : 'Check the photos', checkAgain),
        button(
          details.scene ? 'Train' : 'Find the cameras',
          () => app.go(app.id, details.scene ? 'train' : 'cameras'),
          'primary',
        ),
      ),
      videos.length > 0 &&
        el('p', {}, `Videos: ${videos.join(', ')}. Cameras are found in their sharpest frames.`),
      pictures.length > 0 && photoGrid(app),
      details.photos === 'input' &&
        el(
          'section',
          {},
          el('h2', {}, 'More photos'),
          dropZone('Drop more photos here', async ({files}, tell) => {
            await upload(app, server, files, tell);
            await app.act(check);
          }),
        ),
      projectSettings(app),
    ),
    update: list.update,
  };
}

function choice(label, words, options) {
  const select = el(
    'select',
    {id: `choice-${label}`},
    options.map(([value, text]) => el('option', {value}, text)),
  );
  return {
    node: el('label.field', {for: `choice-${label}`}, el('span', {}, label), select),
    words: () => (select.value ? [words, select.value] : []),
  };
}

export function showCameras(app) {
  const {details} = app,
    hasOwn = details.scene !== null && details.scene === details.photos;
  const list = jobList(
    app,
    ['reconstruct'],
    () => 'Cameras',
    ({summary}) => el('p.summary', {}, summary),
  );
  const choices = [
    choice('Photos are compared', '--matching', [
      ['', 'as their number suggests'],
      ['exhaustive', 'all with all'],
      ['sequential', 'neighbors by name'],
    ]),
    choice('Lens', '--camera-model', [
      ['', 'ordinary'],
      ['OPENCV', 'ordinary, strongly distorted'],
      ['OPENCV_FISHEYE', 'fisheye'],
    ]),
    choice('Frames of videos', '--frames', [
      ['', '200'],
      ['100', '100'],
      ['400', '400'],
    ]),
  ];
  const find = () => {
    const isChosen = details.left_out.length > 0 || Object.keys(details.turned).length > 0;
    app.act(server =>
      server.run([
        'reconstruct',
        isChosen ? 'chosen-{id}' : details.photos,
        '-o',
        'scene-{id}',
        ...choices.flatMap(({words}) => words()),
      ]),
    );
  };
  const toTrain = button('Train', () => app.go(app.id, 'train'), 'primary');
  if (hasOwn)
    return {
      node: el(
        'main',
        {},
        el(
          'section.card',
          {},
          el('h2', {}, 'Cameras are known'),
          el('p', {}, 'The folder says where its photos were taken, so this step is done.'),
          el('div.buttons', {}, toTrain),
        ),
      ),
      update: () => {},
    };
  return {
    node: el(
      'main',
      {},
      el(
        'section.card',
        {},
        el('h2', {}, 'Where were the photos taken?'),
        el(
          'p.muted',
          {},
          'COLMAP compares the photos and finds cameras and points. 100 photos take some minutes.',
        ),
        el(
          'div.fields',
          {},
          choices.map(({node}) => node),
        ),
        el(
          'div.buttons',
          {},
          details.scene && toTrain,
          button(
            details.scene ? 'Find them again' : 'Find the cameras',
            find,
            details.scene ? '' : 'primary',
          ),
        ),
      ),
      list.node,
    ),
    update: () => list.update(),
    isBusy: Boolean(list.newest && isActive(list.newest)),
  };
}
