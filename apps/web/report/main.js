// SPDX-License-Identifier: Apache-2.0
// Entry point of the report: reads the data that gemsplat put into the page, and shows it as a run
// or as an experiment.
import {el} from '../shared/dom.js';
import {showExperiment} from './experiment.js';
import {showRun} from './run.js';

const page = document.getElementById('page');
try {
  const data = JSON.parse(document.getElementById('data').textContent);
  document.title = `${data.title} · gemsplat`;
  page.replaceChildren(...(data.kind === 'experiment' ? showExperiment(data) : showRun(data)));
} catch (error) {
  page.replaceChildren(
    el(
      'p.card.failure',
      {role: 'alert'},
      `This report cannot be shown: ${error.message}. "gemsplat report FOLDER" writes it again.`,
    ),
  );
  throw error;
}
